"""What sensors can tell apart at all: from the structure of the model, before any measurement is looked at.

An unknown effort or flow at a place reaches the sensors through its transfer functions. Two places whose vectors of
transfer functions are parallel at every frequency explain the same measurements, with other courses of the unknown:
no data tell them apart unless a law ties the course down. A place whose vector vanishes is invisible. Both are decided
numerically at random complex frequencies and operating points, which meets the generic rank with probability one.
Neither depends on units: frequencies lie between the rates of the machine, and an unknown is as large as it moves it.
Reference: Basseville and Nikiforov (1993), chapter 9; Blanke et al. (2016), chapter 5, for structural detectability and
isolability; Schwartz (1980), J. ACM 27(4), for random points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph.build import BuiltModel
from bondgraph.correct.places.probes import probed_model
from bondgraph.correct.places.sums import summed_outputs
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.model import Model

_POINTS = 8
#: Frequencies in rates of the machine, from its slowest to its fastest.
_FREQUENCIES = (0.4 + 1.1j, 2.3 + 0.7j, 0.3 + 1.6j, 0.5 + 0.9j)
#: Rates below this share of the fastest are those of integrals.
_STILL = 1e-9
#: Sine of the angle between vectors that are parallel, and size of those that vanish: what finite differences leave.
_PARALLEL, _VANISHING = 1e-5, 1e-7


@dataclass(frozen=True)
class Structure:
    """Places and sensors by label: ``classes`` that no course of an unknown tells apart, and those that are invisible.

    ``sensors`` are the measured outputs on which this rests; ``sums`` are sentences on those that add elements of one
    junction, see :func:`bondgraph.correct.places.sums.summed_outputs`.
    """

    classes: tuple[tuple[str, ...], ...]
    invisible: tuple[str, ...]
    sensors: tuple[str, ...]
    sums: tuple[str, ...] = ()

    def like(self, label: str) -> tuple[str, ...]:
        """The other places of the same class."""
        return next((tuple(o for o in own if o != label) for own in self.classes if label in own), ())


def structure(built: BuiltModel, where: Sequence[Place], logs: Sequence[MatchedLog], sizes: FloatArray) -> Structure:
    """Classes of places that these sensors cannot tell apart.

    Parameters
    ----------
    built
        The declared model.
    where
        Places and sensors.
    logs
        Say which outputs are measured and what the inputs are; no measured value is used.
    sizes
        Sizes of the states, shape (n_x,), from which operating points are drawn.
    """
    model, names = probed_model(built.graph, where)
    rows = [
        row
        for row in range(len(model.outputs))
        if any(np.isfinite(log.y[row]).any() for log in logs)
    ]  # fmt: skip
    sensors = [model.names("output")[row] for row in rows]
    labels = [*names, *(f"sensor {name}" for name in sensors)]
    vectors = _vectors(model, list(names.values()), rows, logs, _sizes(built, model, sizes))
    visible = [k for k in range(len(labels)) if any(np.linalg.norm(v[:, k]) > _VANISHING for v in vectors)]
    groups: list[list[int]] = []
    for k in visible:
        twin = next((group for group in groups if _parallel(vectors, group[0], k)), None)
        if twin is None:
            groups.append([k])
        else:
            twin.append(k)
    invisible = tuple(label for k, label in enumerate(labels) if k not in visible)
    classes = tuple(tuple(labels[k] for k in group) for group in groups if len(group) > 1)
    return Structure(classes, invisible, tuple(sensors), summed_outputs(built.graph, sensors))


def everywhere(built: BuiltModel) -> list[Place]:
    """All junctions and sensors, of whatever size: the structure knows no data."""
    one = Scale(1.0, 1.0)
    nodes = built.causal.graph.nodes.values()
    return [
        *(Place(handle(built.graph, node.name), one) for node in nodes if node.is_junction),
        *(Place.sensor(name, one) for name in built.model.names("output")),
    ]


def _sizes(built: BuiltModel, model: Model, sizes: FloatArray) -> FloatArray:
    known = dict(zip(built.model.names("state"), sizes, strict=True))
    return np.array([known.get(name, 1.0) for name in model.names("state")])


def _vectors(
    model: Model, probes: Sequence[str], rows: Sequence[int], logs: Sequence[MatchedLog], sizes: FloatArray
) -> list[FloatArray]:
    """Transfer vectors (sensors, places) at random frequencies and points, each sensor scaled by its largest entry.

    Places are scaled before: a flow in m^3/s and a pressure in Pa have no size in common.
    """
    rng = np.random.default_rng(20240517)
    inputs = np.concatenate([inputs_of(model, log) for log in logs], axis=1)
    found: list[FloatArray] = []
    for _ in range(_POINTS):
        x = sizes * rng.uniform(0.15, 1.0, sizes.size)
        u = inputs[:, rng.integers(inputs.shape[1])]
        a, b, c, d = _matrices(model, probes, x, u, sizes)
        if not all(np.isfinite(matrix).all() for matrix in (a, b, c, d)):
            continue
        for frequency in _frequencies(a):
            try:
                whole = (c @ np.linalg.solve(frequency * np.eye(x.size) - a, b) + d)[rows]
            except np.linalg.LinAlgError:  # a pole lies on this frequency; others tell as much
                continue
            if not np.isfinite(whole).all():
                continue
            whole = whole / _moved(b, d[rows], frequency)
            largest = np.abs(whole).max(axis=1, keepdims=True, initial=0.0)
            scaled = np.where(largest > 0.0, whole / np.where(largest > 0.0, largest, 1.0), 0.0)
            found.append(np.concatenate([scaled, np.eye(len(rows))], axis=1))
    return found


def _frequencies(a: FloatArray) -> list[complex]:
    """Complex frequencies, 1/s, over the rates of a linear model; those of a machine that only integrates are any."""
    rates = np.abs(np.linalg.eigvals(a))
    moving = rates[rates > _STILL * rates.max(initial=0.0)]
    if not moving.size:
        return list(_FREQUENCIES)
    scales = np.geomspace(moving.min(), moving.max(), len(_FREQUENCIES))
    return [complex(scale * one) for scale, one in zip(scales, _FREQUENCIES, strict=True)]


def _moved(b: FloatArray, d: FloatArray, frequency: complex) -> FloatArray:
    """How far each unknown of one moves the states over their sizes, or else the sensors, shape (places,)."""
    states, shown = np.linalg.norm(b, axis=0) / abs(frequency), np.linalg.norm(d, axis=0)
    moved = np.where(states > 0.0, states, shown)
    return np.where(moved > 0.0, moved, 1.0)


def _matrices(
    model: Model, probes: Sequence[str], x: FloatArray, u: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The linear model in the states, each over its size, and the probes, by central differences."""
    theta, index = model.theta(), [model.index("parameter", name) for name in probes]

    def values(shift: FloatArray, probe: FloatArray) -> tuple[FloatArray, FloatArray]:
        own = np.repeat(theta[:, np.newaxis], shift.shape[1], axis=1)
        own[index] += probe
        at = x[:, np.newaxis] + sizes[:, np.newaxis] * shift
        with np.errstate(all="ignore"):
            return model.rhs(0.0, at, u, own) / sizes[:, np.newaxis], model.output(0.0, at, u, own)

    step, push = 1e-5 * np.eye(x.size), np.eye(len(index))
    none_x, none_p = np.zeros((x.size, len(index))), np.zeros((len(index), x.size))
    pairs = []
    for one, other, width in (
        (values(step, none_p), values(-step, none_p), 2e-5),
        (values(none_x, push), values(none_x, -push), 2.0),
    ):
        pairs += [(one[0] - other[0]) / width, (one[1] - other[1]) / width]
    return pairs[0], pairs[2], pairs[1], pairs[3]


def _parallel(vectors: Sequence[FloatArray], a: int, b: int) -> bool:
    """Whether two columns are parallel wherever both are seen."""
    compared = 0
    for vector in vectors:
        one, other = vector[:, a], vector[:, b]
        size = float(np.linalg.norm(one) * np.linalg.norm(other))
        if size <= _VANISHING**2:
            continue
        compared += 1
        apart = other - one * (np.vdot(one, other) / np.vdot(one, one))
        if np.linalg.norm(apart) > _PARALLEL * np.linalg.norm(other):
            return False
    return compared > 0
