"""Where a residual comes from: an unknown at every place, as a free function of the place's own variable and of time.

Every junction is given an unknown effort (1-junction) or flow (0-junction), every sensor an unknown error, of a shape
that is not fixed: a piecewise linear function of the own flow or effort, a share of its rate, and a function of time.
How much of the residual each explains is a score test with as many degrees of freedom. It presupposes no law, and so
ranks places before any effect is offered there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph.correct.places.probes import Probe, Signal, Variable, hats, knots, shaped
from bondgraph.correct.scores.score import best_step
from bondgraph.correct.scores.scoring import Linearisation
from bondgraph.data.log import FloatArray

#: Knots over the own variable and over time.
_OWN, _TIME = 6, 4


@dataclass(frozen=True)
class LocatedAt:
    """One place and how well what is missing there explains the residual.

    ``variable`` is what would be missing: an ``"effort"`` at a 1-junction, a ``"flow"`` at a 0-junction, or an error of
    a ``"sensor"``. ``p_value`` is corrected for all places; ``share`` the likelihood gain over the largest of any
    place, so that places which explain the residual equally well all have 1.
    """

    junction: str
    variable: Variable
    p_value: float
    share: float
    gain: float


def locate(linear: Linearisation, found: Sequence[Probe], known: Sequence[Signal]) -> tuple[LocatedAt, ...]:
    """The places, those that explain most first."""
    time = next((signal for signal in known if signal.name == "time"), None)
    own = {signal.name.partition(" of ")[2]: signal for signal in known if " of " in signal.name}
    if not found:
        return ()
    shapes = [
        [_courses(linear, probe, k, own.get(probe.place.label), time) for k in range(len(linear.logs))]
        for probe in found
    ]
    sizes = [courses[0].shape[0] for courses in shapes]
    columns, _ = linear.responses(sizes, lambda part, k: shaped(found[part].changes[k], shapes[part][k]))
    projected = linear.projected(columns)
    edges = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    listed = []
    for probe, first, end in zip(found, edges[:-1], edges[1:], strict=True):
        _, gain, p_value = best_step(projected, list(range(first, end)), np.zeros(end - first, dtype=bool))
        listed.append((probe, gain, min(1.0, p_value * len(found))))
    largest = max(gain for _, gain, _ in listed)
    places = [
        LocatedAt(probe.place.output or probe.place.label, probe.variable, p, gain / largest if largest else 0.0, gain)
        for probe, gain, p in listed
    ]
    return tuple(sorted(places, key=lambda place: (-round(place.share, 6), place.p_value)))


def _courses(linear: Linearisation, probe: Probe, k: int, own: Signal | None, time: Signal | None) -> FloatArray:
    """The courses (lanes, n) that the unknown of a probe may take in one log."""
    path = linear.logs[k].path
    courses: list[FloatArray] = [np.ones((1, path.time.size))]
    if probe.variable == "sensor":
        row = linear.model.index("output", probe.place.output)
        shown = linear.model.output(path.time, path.before, path.u, path.theta)[row]
        courses.append(np.array([shown, np.gradient(shown, path.time)]))
    elif own is not None:
        courses.append(hats(own.values[k], knots(own, _OWN))[1:])
        courses.append(np.gradient(own.values[k], path.time)[np.newaxis])  # what a storage takes
    if time is not None:
        courses.append(hats(time.values[k], knots(time, _TIME))[1:])
    return np.concatenate(courses)
