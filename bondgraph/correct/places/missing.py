"""The picture of what is missing: an unknown effort or flow at a junction, followed through the logs.

A load that walks at random is put at the junction (an effort at a 1-junction, a flow at a 0-junction) and followed by
the filter as one more state; the smoother says how large it was at every sample. How fast it walks, and how much of the
model's own process noise is needed beside it, are chosen by likelihood. It shows a law to the eye and proves none: its
neighbouring values are not independent.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.models.bonds import bond_model
from bondgraph.correct.places.probes import hats, probed_model, shaped
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import Place
from bondgraph.derive.causality import bond_labels
from bondgraph.errors import EstimationError, OptionError
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.initial import initial_states
from bondgraph.estimate.objective import over_terms
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.linear.recursion import respond
from bondgraph.filter.linear.response import LinearLog, Path, linearise, model_change
from bondgraph.filter.runs import run
from bondgraph.filter.smoother import smooth
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model

#: Walks that are tried, as shares of the effort there per sqrt(s), and shares of the process noise beside them.
_WALKS = (0.01, 0.03, 0.1, 0.3, 1.0)
_SHARES = (0.03, 0.3, 1.0)
#: Distance of the knots of the course in a linearised filter [s], and lanes that go through it at once.
_KNOT_SECONDS, _LANES = 1.0, 96


@dataclass(frozen=True)
class MissingEffort:
    """What is missing at a junction at each sample of all logs, one after the other.

    ``flow`` of the junction, ``effort`` that is missing there (positive where it takes energy from a positive flow) and
    its standard deviation ``std``, each (n,). At a 0-junction, where efforts are common, the two change places.
    """

    junction: str
    effort_unit: str
    flow_unit: str
    flow: FloatArray
    effort: FloatArray
    std: FloatArray


def missing_effort(built: BuiltModel, fitted: Fit, logs: Sequence[MatchedLog], place: Place) -> MissingEffort:
    """The effort that a model lacks at a 1-junction, or the flow at a 0-junction, by smoothing.

    Parameters
    ----------
    built
        The model without the effect.
    fitted
        Values of its parameters and noise levels, taken by name. With the fit of the declared model the picture is that
        of its residual, in which free parameters have hidden a part; with the fit of the corrected one it is the whole
        effect.
    logs
        Matched logs.
    place
        A junction, with the sizes of its effort and flow.

    Raises
    ------
    OptionError
        If the place is not a junction.
    EstimationError
        If the filter diverges with every walk that is tried.
    """
    if place.bond is not None or place.junction.kind not in ("0", "1"):
        raise OptionError(
            f"{place.label}: a missing effort acts at a 1-junction, a missing flow at a 0-junction - name one of the "
            "graph",
            where=(place.label,),
        )
    if fitted.problem.filter_model.is_stiff:
        return missing_in_blocks(built, fitted, logs, place)
    extended, load = _with_load(built, place)
    filter_model = _followed(extended, fitted, load, place)
    theta = extended.model.theta(**_known(fitted, extended.model.names("parameter")))
    noise = np.array([_noise(fitted).get(name, np.nan) for name in extended.model.names("output")])
    x0 = initial_states(extended.model, logs, theta, fitted.problem.initial)
    walk = _likeliest(filter_model, logs, theta, noise, x0, place)
    pieces = []
    for log, start in zip(logs, x0, strict=True):
        filtered = run(filter_model, log, theta, noise_std=noise, process_std=walk, x0=start)
        smoothed = smooth(filtered.raise_if_failed())
        states = smoothed.smoothed_mean[: len(extended.model.states)]
        flow = _flow(extended, place, log, states, theta, load, smoothed.mean(load))
        pieces.append(np.array([flow, smoothed.mean(load), smoothed.std(load)]))
    flow, effort, std = np.concatenate(pieces, axis=1)
    domain = place.domain
    units = ("", "") if domain is None else (domain.effort_unit, domain.flow_unit)
    units = units if place.junction.kind == "1" else units[::-1]
    return MissingEffort(place.label, *units, flow, effort, std)


def missing_in_blocks(built: BuiltModel, fitted: Fit, logs: Sequence[MatchedLog], place: Place) -> MissingEffort:
    """The same from the linearised filter, where another model would take long to compile: straight between knots.

    The knots are a fixed time apart; how much neighbouring ones may differ is chosen by the evidence of a Gaussian
    random walk through them. Reference: MacKay (1992), Neural Computation 4(3).
    """
    own = fitted.problem.filter_model
    bare = replace(
        own,
        model=built.model,
        process_noise={name: std for name, std in _process(fitted).items() if name in built.model.names("state")},
        initial_std={
            name: std for name, std in fitted.elsewhere.initial_std.items() if name in built.model.names("state")
        },
        measurement_noise={**own.measurement_noise, **_noise(fitted)},
    )
    theta = fitted.theta_of(built.model)
    x0 = initial_states(built.model, logs, theta, fitted.problem.initial)
    model, names = probed_model(built.graph, [place])
    if place.label not in names:
        raise EstimationError(f"{place.label}: causality leaves no room for an unknown there", where=(place.label,))
    pieces = []
    for log, start in zip(logs, x0, strict=True):
        linear = linearise(run(bare, log, theta, x0=start).raise_if_failed(), log, theta)
        values, std = _walk(linear, model, names[place.label], _size(place))
        pieces.append(np.array([_common(built, place, linear.path), values, std]))
    flow, effort, std = np.concatenate(pieces, axis=1)
    domain = place.domain
    units = ("", "") if domain is None else (domain.effort_unit, domain.flow_unit)
    units = units if place.junction.kind == "1" else units[::-1]
    return MissingEffort(place.label, *units, flow, effort, std)


def _process(fitted: Fit) -> dict[str, float]:
    batch = fitted.problem.batch(fitted.point[:, np.newaxis])
    names = fitted.problem.filter_model.state_names
    return dict(zip(names, map(float, batch.process_std[:, 0]), strict=True))


def _walk(linear: LinearLog, probed: Model, name: str, size: float) -> tuple[FloatArray, FloatArray]:
    """The likeliest course of an unknown (n,) and its standard deviation."""
    path = linear.path
    theta = probed.theta(**path.parameters(probed), **{name: 1e-3 * size})
    change = model_change(path, probed, theta, 1e-3)  # lanes in units of the size
    count = max(4, int((path.time[-1] - path.time[0]) / _KNOT_SECONDS))
    at = np.linspace(path.time[0], path.time[-1], count)
    courses = hats(path.time, at)
    columns = np.concatenate(
        [respond(linear, shaped(change, courses[k : k + _LANES]))[0] for k in range(0, count, _LANES)], axis=1
    )
    information = over_terms(columns, columns)
    score = -over_terms(columns, linear.whitened.reshape(-1, 1))[:, 0]
    steps = np.diff(np.eye(count), axis=0)
    best: tuple[float, FloatArray, FloatArray] | None = None
    for share in _WALKS:
        prior = steps.T @ steps / share**2 + np.eye(count) * 1e-2
        values, vectors = np.linalg.eigh(information + prior)
        found = vectors @ ((vectors.T @ score) / values)
        evidence = 0.5 * (float(score @ found) - float(np.log(values).sum()) + float(np.linalg.slogdet(prior)[1]))
        if best is None or evidence > best[0]:
            best = (evidence, found, (vectors / values) @ vectors.T)
    if best is None:
        raise EstimationError("no course of an unknown was tried")
    _, found, cov = best
    return size * (courses.T @ found), size * np.sqrt(np.einsum("kn,kl,ln->n", courses, cov, courses))


def _common(built: BuiltModel, place: Place, path: Path) -> FloatArray:
    """The variable that is common at a junction along a path, shape (n,)."""
    model, labels = bond_model(built.causal), bond_labels(built.causal)
    bond = built.causal.graph.incidence()[place.junction.name][0][0]
    row = len(built.model.outputs) + bond + (len(labels) if place.junction.kind == "1" else 0)
    theta = model.theta(**path.parameters(model))
    common: FloatArray = model.output(path.time, path.before, path.u, theta)[row]
    return common


def _with_load(built: BuiltModel, place: Place) -> tuple[BuiltModel, str]:
    graph = copy(built.graph)
    name = f"missing_effort_{place.name}"
    load = graph.parameter(name, 0.0, "", f"what is missing at {place.label}")
    declare = graph.effort_source if place.junction.kind == "1" else graph.flow_source
    declare(f"source_{name}", -load, at=handle(graph, place.junction.name))
    return build(graph), name


def _size(place: Place) -> float:
    """Size of the variable that is missing."""
    return place.scale.effort if place.junction.kind == "1" else place.scale.flow


def _known(fitted: Fit, names: Sequence[str]) -> dict[str, float]:
    model = fitted.problem.filter_model.model
    values = dict(zip(model.names("parameter"), map(float, fitted.theta), strict=True))
    return {name: values[name] for name in names if name in values}


def _noise(fitted: Fit) -> dict[str, float]:
    batch = fitted.problem.batch(fitted.point[:, np.newaxis])
    outputs = fitted.problem.filter_model.model.names("output")
    return dict(zip(outputs, map(float, batch.noise_std[:, 0]), strict=True))


def _followed(extended: BuiltModel, fitted: Fit, load: str, place: Place) -> FilterModel:
    """The filter of the fit on the extended model, the load one of its states."""
    own = fitted.problem.filter_model
    batch = fitted.problem.batch(fitted.point[:, np.newaxis])
    process = dict(zip(own.state_names, map(float, batch.process_std[:, 0]), strict=True))
    states = extended.model.names("state")
    start = {name: value for name, value in fitted.elsewhere.initial_std.items() if name in states}
    return replace(
        own,
        model=extended.model,
        process_noise={name: process[name] for name in states if name in process},
        initial_std={**start, load: _size(place)},
        appended={load: _size(place)},
    )


def _likeliest(
    filter_model: FilterModel,
    logs: Sequence[MatchedLog],
    theta: FloatArray,
    noise: FloatArray,
    x0: Sequence[FloatArray],
    place: Place,
) -> FloatArray:
    """Process noise (n_s,) of the likeliest pair of a walk and a share of the model's own noise."""
    pairs = np.array(list(itertools.product(_SHARES, _WALKS))).T
    own = filter_model.process_std[:-1]
    process = np.concatenate([np.outer(own, pairs[0]), _size(place) * pairs[1:]])
    values = likelihood(
        filter_model, list(logs), theta, noise_std=noise, process_std=process, x0=[*x0]
    ).nll  # fmt: skip
    if not np.isfinite(values).any():
        raise EstimationError(
            f"{filter_model.model.name}: the filter diverges with an unknown effort at {place.label} - fit it first",
            where=(place.label,),
        )
    best: FloatArray = process[:, int(np.argmin(values))]
    return best


def _flow(
    extended: BuiltModel,
    place: Place,
    log: MatchedLog,
    states: FloatArray,
    theta: FloatArray,
    load: str,
    effort: FloatArray,
) -> FloatArray:
    """The junction's common variable at each sample, from smoothed states and load."""
    model = bond_model(extended.causal)
    known = np.repeat(theta[:, np.newaxis], log.time.size, axis=1)
    for name, value in log.theta_overrides.items():
        known[model.index("parameter", name)] = value
    known[model.index("parameter", load)] = effort
    outputs = model.output(log.time, states, inputs_of(model, log), known)
    labels = bond_labels(extended.causal)
    source = labels.index(f"source_missing_effort_{place.name}->{place.junction.name}")
    flows = len(labels) if place.junction.kind == "1" else 0
    common: FloatArray = outputs[len(extended.model.outputs) + flows + source]
    return common
