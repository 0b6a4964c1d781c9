"""Candidates: every effect function at every place where it makes sense, and one graph that holds them all."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from sympy import Expr

from bondgraph.build import BuiltModel, build, model_of
from bondgraph.correct.models.bonds import bond_model
from bondgraph.correct.models.failures import attempted, has_rates
from bondgraph.correct.models.pairs import pairs, sizes
from bondgraph.correct.models.typical import graded_inputs
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import SMOOTHING, Effect, EffectFunction, Place, Scale, is_for, is_shipped
from bondgraph.declare.elements import STORAGES
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import assign_causality, bond_labels
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.equations import ImplicitLoop, StateEquations
from bondgraph.errors import (
    BondGraphError,
    CausalityError,
    DeclarationError,
    EstimationError,
    LawError,
    OptionError,
    suggest,
)
from bondgraph.filter.filter_run import FilterRun
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model

#: Values of a shape parameter that are tried, as shares of its bounds (on a logarithmic scale where these allow it).
_SHAPES = (0.1, 0.35, 0.65, 0.9)
#: With several shape parameters each takes fewer values.
_FEWER_SHAPES = (0.2, 0.5, 0.8)
#: Coefficients of smooth laws are probed at this share of their bounds.
_PROBE = 1e-4
#: Over which share of a flow's scale dry friction turns round where the filter integrates by a stiff method.
_STEEP = 0.002


@dataclass(frozen=True, repr=False)
class Candidate:
    """One effect at one place: a way in which the declared graph may be incomplete.

    ``passive``: its coefficients cannot be negative, so that it only takes energy. ``beside_storage``: the place is a
    junction with a storage, whose flow or effort is a state. ``model`` is that of the graph with the effect.
    ``followed``: states that the effect brings are integrals of the others, so that its response can be scored.
    ``laws`` are those of the element that the effect added or changed.
    """

    function: EffectFunction
    place: Place
    effect: Effect
    model: Model
    passive: bool = True
    beside_storage: bool = True
    followed: bool = True
    laws: tuple[Expr, ...] = ()

    def __repr__(self) -> str:
        return f"<Candidate {self.label}>"

    @property
    def label(self) -> str:
        """Effect, place and regime as a person reads them."""
        where = f" where {self.effect.regime}" if self.effect.regime else ""
        return f"{self.effect.name} at {self.place.label}{where}"

    @functools.cached_property
    def bends(self) -> bool:
        """True for a law that is not straight in its coefficients: its response changes as they grow."""
        own = {symbol(name) for name in self.effect.coefficients}
        return any(law.diff(one).free_symbols & own for law in self.laws for one in own & law.free_symbols)

    def parts_from(self, other: Candidate) -> bool:
        """True for two laws whose responses, equal at zero, part as their coefficients grow."""
        return self.function.__name__ != other.function.__name__ and (self.bends or other.bends)

    def apply(self, graph: BondGraph) -> BondGraph:
        """The graph with this effect; the given one is left alone.

        Raises
        ------
        DeclarationError
            If the effect has no place there: another law took it, or what it needs is gone.
        """
        extended = copy(graph)
        if self.function(extended, placed(extended, self.place)) is None:
            raise DeclarationError(
                f"{graph.name}: {self.label} does not fit beside what was added before", where=(self.place.label,)
            )
        return extended

    def at(self, place: Place, graph: BondGraph) -> Candidate:
        """The same effect function at another place of a graph.

        Raises
        ------
        DeclarationError
            If the effect has no place there.
        """
        extended = copy(graph)
        effect = self.function(extended, placed(extended, place))
        if effect is None:
            raise DeclarationError(f"{graph.name}: {self.label} does not fit any more", where=(self.place.label,))
        return replace(self, place=place, effect=effect, model=build(extended).model)

    @property
    def lower(self) -> FloatArray:
        """Lower bounds of the coefficients."""
        return np.array([self.bounds(name)[0] for name in self.effect.coefficients])

    @property
    def upper(self) -> FloatArray:
        """Upper bounds of the coefficients."""
        return np.array([self.bounds(name)[1] for name in self.effect.coefficients])

    @property
    def variants(self) -> tuple[Variant, ...]:
        """The shapes and amplitudes at which the effect is tried; one, without shapes, where it is linear."""
        own = dict(self.effect.grids)
        grids = [own.get(name) or self._values(name) for name in self.effect.shapes]
        shapes = [dict(zip(self.effect.shapes, values, strict=True)) for values in itertools.product(*grids)]
        small = _PROBE * (self.upper - self.lower)
        first = [self._amplitude(share) for share in self.effect.amplitudes] or [small[0]]
        return tuple(Variant(shape, (size, *small[1:])) for shape in shapes for size in first)

    def _amplitude(self, share: float) -> float:
        lower, upper = self.lower[0], self.upper[0]
        return float(lower * (upper / lower) ** share if lower > 0.0 else share * upper)

    def bounds(self, name: str) -> tuple[float, float]:
        """Bounds of a coefficient or shape; no coefficient of a dissipative law is negative.

        Raises
        ------
        EstimationError
            If the effect function declares none.
        """
        info = self.model.parameters[self.model.index("parameter", name)]
        if info.lower is None or info.upper is None:
            raise EstimationError(
                f"{self.label}: its coefficient {name} has no bounds, so nothing says how large it may be - "
                "declare them in the effect function",
                where=(name,),
            )
        loss = self.effect.dissipative and name in self.effect.coefficients
        return max(info.lower, 0.0) if loss else info.lower, info.upper

    def _values(self, name: str) -> list[float]:
        shares = _SHAPES if len(self.effect.shapes) == 1 else _FEWER_SHAPES
        lower, upper = self.bounds(name)
        if lower > 0.0:
            return [lower * (upper / lower) ** share for share in shares]
        return [lower + share * (upper - lower) for share in shares]


@dataclass(frozen=True)
class Variant:
    """One way of trying a candidate: values of its shapes, and the size of each coefficient at which it is probed."""

    shapes: Mapping[str, float]
    sizes: tuple[float, ...]


def placed(graph: BondGraph, place: Place) -> Place:
    """The same place of another graph."""
    if place.output:
        return place
    other = None if place.other is None else handle(graph, place.other.name)
    return replace(place, junction=handle(graph, place.junction.name), other=other)


@dataclass(frozen=True)
class Refused:
    """An effect that could not be tried at a place, and why; ``shipped``: it is one of the toolkit's own."""

    effect: str
    place: str
    why: str
    shipped: bool = False


def places(built: BuiltModel, logs: Sequence[MatchedLog], runs: Sequence[FilterRun], theta: FloatArray) -> list[Place]:
    """All junctions, bonds, pairs of junctions and sensors with the size of effort and flow in the filtered runs.

    A place where nothing moves, or no effort acts, in any log is left out: no effect could be seen there. Stiff methods
    bear friction that turns round at once, so that no start from rest is taken for motion without friction.
    """
    graph = built.graph
    flat = built.causal.graph
    labels = bond_labels(built.causal)
    values = _bond_values(built, logs, runs, theta)
    effort, flow = sizes(values[0]), sizes(values[1])
    incidence = flat.incidence()
    smoothing = _STEEP if any(run.filter_model.is_stiff for run in runs) else SMOOTHING
    found = []
    for node in flat.nodes.values():
        if node.is_junction:
            bonds = [index for index, _ in incidence[node.name]]
            scale = Scale(max(effort[b] for b in bonds), max(flow[b] for b in bonds))
            if min(scale.effort, scale.flow) > 0.0:
                found.append(Place(handle(graph, node.name), scale, smoothing=smoothing))
    for bond in graph.bonds:
        index = labels.index(f"{bond.source}->{bond.target}") if f"{bond.source}->{bond.target}" in labels else -1
        if index >= 0 and min(effort[index], flow[index]) > 0.0:
            scale = Scale(effort[index], flow[index])
            found.append(Place(handle(graph, bond.source), scale, bond, smoothing=smoothing))
    every = [*found, *pairs(built.graph, flat, values, smoothing), *_sensors(built.model, logs)]
    times, told = times_of(logs), graded_inputs(built.model, logs)
    return [replace(place, times=times, commands=told) for place in every]


def times_of(logs: Sequence[MatchedLog]) -> tuple[float, float]:
    """From the time between samples to the length of the longest log, s."""
    return (
        min(float(np.median(np.diff(log.time))) for log in logs),
        max(float(log.time[-1] - log.time[0]) for log in logs),
    )


def _sensors(model: Model, logs: Sequence[MatchedLog]) -> list[Place]:
    """The measured outputs; one that shows the same value all the time cannot be told to be wrong in scale."""
    found = []
    for row, name in enumerate(model.names("output")):
        seen = np.concatenate([log.y[row][np.isfinite(log.y[row])] for log in logs])
        size = float(np.percentile(np.abs(seen), 99.0)) if seen.size else 0.0
        if size > 0.0:
            found.append(Place.sensor(name, Scale(size, float(np.percentile(np.abs(seen - np.mean(seen)), 99.0)))))
    return found


def _bond_values(
    built: BuiltModel, logs: Sequence[MatchedLog], runs: Sequence[FilterRun], theta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Each bond's effort and flow along all logs, (bonds, samples); what is not finite counts as zero."""
    model = bond_model(built.causal)
    own = len(built.equations.outputs)
    pieces = []
    for log, run in zip(logs, runs, strict=True):
        known = theta.copy()
        for name, value in log.theta_overrides.items():
            known[model.index("parameter", name)] = value
        with np.errstate(all="ignore"):
            outputs = model.output(log.time, run.filtered_mean[: len(model.states)], inputs_of(model, log), known)
        pieces.append(outputs[own:])
    together = np.concatenate(pieces, axis=1)
    together[~np.isfinite(together)] = 0.0
    count = len(built.causal.graph.bonds)
    return together[:count], together[count:]


def candidates(
    built: BuiltModel,
    functions: Sequence[EffectFunction],
    where: Sequence[Place],
    present: Collection[tuple[str, str]] = (),
) -> tuple[list[Candidate], list[Refused]]:
    """Every effect at every place, where the extended graph has a causality, storages without a further nonlinear loop.

    ``present`` holds the effects that the graph already has, by name of their function and label of their place.

    Raises
    ------
    OptionError
        If an effect function fails, or names coefficients that it does not declare.
    """
    found: list[Candidate] = []
    refused: list[Refused] = []
    for place in where:
        for function in functions:
            if (function.__name__, place.label) in present or not is_for(function, place):
                continue
            trial = copy(built.graph)
            try:
                effect = _effect(function, trial, place)
                if effect is None:
                    continue
                causal = assign_causality(trial)
                equations = Derivation(causal).equations()
            except OptionError:
                raise
            except BondGraphError as error:
                refused.append(Refused(function.__name__, place.label, _refusal(function, error), is_shipped(function)))
                continue
            flat = causal.graph
            why = _why_not(built, flat, effect, equations)
            if why is not None:
                refused.append(Refused(effect.name, place.label, why, is_shipped(function)))
                continue
            beside = _beside_storage(built, place)
            own = {state.symbol.name for state in built.equations.states}
            followed = all(s.variable == "integral" or s.symbol.name in own for s in equations.states)
            name = f"{built.graph.name} with {effect.name}"
            model = attempted(functools.partial(model_of, equations, name, own=True), lambda why: None)
            if model is None or (_loops(equations) > built.implicit_loops and not has_rates(model)):
                why = "would have no rates at the declared values"
                refused.append(Refused(effect.name, place.label, why, is_shipped(function)))
                continue
            element = flat.nodes.get(effect.element)
            laws = () if element is None else tuple(law for _, law in element.laws)
            found.append(Candidate(function, place, effect, model, _passive(flat, effect), beside, followed, laws))
    return found, refused


def _effect(function: EffectFunction, graph: BondGraph, place: Place) -> Effect | None:
    """What an effect function added; its own mistakes are told as such."""
    try:
        effect = function(graph, place)
    except Exception as error:
        if isinstance(error, BondGraphError) and not isinstance(error, LawError):
            raise  # it does not fit there; a law that fails fits nowhere
        raise OptionError(
            f"effect function {function.__name__} failed at {place.label}: {type(error).__name__}: {error} - mend "
            "it, or let it return None where it makes no sense",
            where=(function.__name__, place.label),
        ) from error
    if effect is None:
        return None
    own = {parameter.name for parameter in graph.parameters}
    known = own if own.issuperset(effect.parameters) else {one.name for one in graph.flatten().parameters}
    for name in effect.parameters:
        if name not in known:
            raise OptionError(
                f"effect function {function.__name__} names the coefficient {name!r} at {place.label} but declares no"
                f" such parameter{suggest(name, known)} - return the names of parameters that it added",
                where=(function.__name__, name),
            )
    return effect


def _refusal(function: EffectFunction, error: BondGraphError) -> str:
    """Why a graph refuses an effect: of one that ships with the package a conflict of causality in a few words."""
    shipped = function.__module__.startswith("bondgraph.effects.")
    return "the graph has no causality with it" if shipped and isinstance(error, CausalityError) else error.message


def _why_not(built: BuiltModel, flat: BondGraph, effect: Effect, equations: StateEquations) -> str | None:
    """Why an effect cannot be tried, or None."""
    values = {parameter.name: parameter.value for parameter in flat.parameters}
    if not effect.coefficients:
        return "has no coefficient that could be tested"
    upper = {parameter.name: parameter.bounds[1] for parameter in flat.parameters if parameter.bounds is not None}
    gaining = [name for name in effect.coefficients if effect.dissipative and not upper.get(name, np.inf) > 0.0]
    if gaining:
        return f"is declared dissipative, but its coefficient {gaining[0]} may not be positive"
    lasting = [name for name in effect.coefficients if values[name] != 0.0]
    if not effect.adds_state and lasting:
        return f"does not vanish: its coefficient is {values[lasting[0]]:g} when it is added, not 0"
    own_inputs = {one.name for one in built.equations.inputs}
    followed = [one.rate_of for one in equations.inputs if one.rate_of and one.name not in own_inputs]
    if followed:
        return (
            f"would need the rate of input {', '.join(followed)}, which the model does not have - declare that storage "
            "in the graph, its size a parameter with bounds"
        )
    if _loops(equations) > built.implicit_loops and effect.adds_state:
        return "would close a nonlinear algebraic loop around a storage of unknown size"
    states = {state.symbol.name for state in equations.states}
    own = {state.symbol.name for state in built.equations.states}
    if not own <= states and not effect.adds_state:
        return f"would take the place of the state {sorted(own - states)[0]}"
    if any(state.variable != "integral" for state in equations.states if state.symbol.name not in own):
        return None if effect.adds_state else "would add a state that has no size yet"
    return None


def _loops(equations: StateEquations) -> int:
    return sum(isinstance(step, ImplicitLoop) for step in equations.assignments)


def _passive(flat: BondGraph, effect: Effect) -> bool:
    bounds = {parameter.name: parameter.bounds for parameter in flat.parameters}
    known = [bounds[name] for name in effect.coefficients]
    if effect.channel or effect.dissipative:
        return effect.dissipative
    return all(bound is not None and bound[0] >= 0.0 for bound in known)


def _beside_storage(built: BuiltModel, place: Place) -> bool:
    if place.output or (place.bond is not None and place.other is None):
        return False
    flat = built.causal.graph
    at = {place.junction.name} if place.other is None else {place.junction.name, place.other.name}
    ends = {end for bond in flat.bonds if at & {bond.source, bond.target} for end in (bond.source, bond.target)}
    return any(flat.nodes[end].kind in STORAGES for end in ends)
