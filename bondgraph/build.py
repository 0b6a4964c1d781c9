"""From a declared graph to a model that can be run: the whole design-time half in one call."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import Path

from bondgraph.declare.domains import ROTATION, TRANSLATION, Domain
from bondgraph.declare.files import load_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.validation import node_domains
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.equations import ImplicitLoop, State, StateEquations
from bondgraph.errors import require_kind
from bondgraph.generate.module import render
from bondgraph.generate.pipeline import render_graph
from bondgraph.simulate.model import Model
from bondgraph.units import dimension


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BuiltModel(Model):
    """A model that knows the graph it was built from; ``text`` is the generated module.

    It equals the model that is loaded from its module, and is pickled as that one.
    """

    graph: BondGraph
    causal: CausalGraph
    equations: StateEquations

    @functools.cached_property
    def model(self) -> Model:
        """The run-time half alone, which holds neither graph nor equations."""
        return Model(**{field.name: getattr(self, field.name) for field in dataclasses.fields(Model)})

    @property
    def driven(self) -> tuple[str, ...]:
        """States that process noise drives by default.

        Unknown efforts act on flows and momenta. A displacement in mechanics follows from flows and nothing drives it
        alone; in other domains (charge, volume, heat) it has its own leaks and sources. Where that leaves none, all.
        """
        domains = node_domains(self.causal.graph)
        chosen = tuple(
            state.symbol.name
            for state in self.equations.states
            if state.variable in ("flow", "momentum") or not _is_mechanical(state, domains.get(state.element))
        )
        return chosen or tuple(state.symbol.name for state in self.equations.states)

    @property
    def implicit_loops(self) -> int:
        """Nonlinear algebraic loops that every evaluation solves."""
        return sum(isinstance(step, ImplicitLoop) for step in self.equations.assignments)


def _is_mechanical(state: State, domain: Domain | None) -> bool:
    """True for a state of mechanics, by its unit where no domain is known; heat in J is no torque in N m."""
    mechanical = (TRANSLATION, ROTATION)
    if domain is not None:
        return domain in mechanical
    units = {dimension(unit) for one in mechanical for unit in (one.displacement_unit, one.effort_unit)}
    return dimension(state.unit) in units


def build(graph: BondGraph | str | Path, command: str | None = None, *, smooth: bool = True) -> BuiltModel:
    """Assign causality, derive, check dimensions, render and load.

    Parameters
    ----------
    graph
        A declared graph, or a reference to one as every command takes it: ``sled.py``, ``sled.py:name``,
        ``module:name`` or a graph file ``sled.json``.
    command
        The command that regenerates the module, for its header.
    smooth
        Take switches, friction and impacts as smooth laws, as filters and estimation need them; else with modes, whose
        events :func:`bondgraph.simulate.simulation.simulate` locates.

    Raises
    ------
    BondGraphError
        If the graph is refused anywhere on the way; the message says where and why.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("free_mass")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    >>> bg.build(g).names("state")
    ('f_mass',)
    """
    require_kind("build", graph, (BondGraph, str, Path), "graph")
    declared = graph if isinstance(graph, BondGraph) else load_graph(str(graph))
    rendered = render_graph(declared, command, smooth=smooth)
    model = Model.from_text(rendered.text, source=declared.name)
    parts = {field.name: getattr(model, field.name) for field in dataclasses.fields(Model)}
    return BuiltModel(**parts, graph=declared, causal=rendered.causal, equations=rendered.equations)


def model_of(equations: StateEquations, source: str, *, own: bool = False) -> Model:
    """The model of equations that were derived with something added: outputs of bonds, a candidate, a probe.

    Parameters
    ----------
    equations
        As derived; a graph's own are checked for names and dimensions by :func:`build`.
    source
        Where they came from, for messages.
    own
        Take the text as it is, as for many models that differ by little from one that was checked.

    Examples
    --------
    >>> g = BondGraph("free_mass")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    >>> model_of(build(g).equations, "a test").names("parameter")
    ('m',)
    """
    return Model.from_text(render(equations), source, own=own)
