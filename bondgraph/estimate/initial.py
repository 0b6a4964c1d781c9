"""Initial states of logs: as declared, or from the first measurements of states that are measured directly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import BoolArray, FloatArray
from bondgraph.estimate.shown_by_curves import OnCurve, shown_by_curves
from bondgraph.filter.follows import Follow, with_followers
from bondgraph.simulate.late import first_inputs, inputs_of
from bondgraph.simulate.model import Model
from bondgraph.simulate.starts import BEGINNING, starts_in

#: ``"model"``: all states start as declared, which may be at a signal of the log; ``"measured"``: those that are
#: measured and declare no signal start at their first measurement; ``"settled"``:
#: and the others where they come to rest while those are held (wheels roll, springs carry, a governor has settled).
InitialRule = Literal["measured", "settled", "model"]
#: A rule, or the states of every log by name, where they are known; states not named start as declared.
Initial = InitialRule | tuple[Mapping[str, float], ...]


@dataclass(frozen=True)
class StartRule:
    """The sources of initial states: first measurements, others that lead them, a rest; as declared without any."""

    measured: bool = False
    led: bool = False
    settled: bool = False


#: By the names of the rules.
_RULES: Mapping[InitialRule, StartRule] = {
    "measured": StartRule(measured=True, led=True),
    "settled": StartRule(measured=True, settled=True),
    "model": StartRule(),
}

#: Time [s] that states get to come to rest; what still moves then (a distance) is left as declared.
_SETTLING = 10.0


def start_rule(initial: Initial) -> StartRule:
    """The rule of a name; states that are given by name follow nothing else.

    Raises
    ------
    EstimationError
        If the name is not one of the three.

    Examples
    --------
    >>> start_rule("settled").measured, start_rule(({"angle": 0.1},)).measured
    (True, False)
    """
    if not isinstance(initial, str):
        return StartRule()
    if initial not in _RULES:
        raise EstimationError(
            f"initial states: rule {initial!r} is not known - choose {', '.join(_RULES)}", where=(initial,)
        )
    return _RULES[initial]


def initial_states(
    model: Model,
    logs: Sequence[MatchedLog],
    theta: FloatArray,
    rule: Initial,
    follows: Sequence[Mapping[str, Follow]] = (),
) -> list[FloatArray]:
    """Initial state of each log, shape (n_x,).

    Parameters
    ----------
    model
        The model; an output that depends on one state and on nothing else unknown measures that state.
    logs
        Matched logs; a parameter known for a log counts.
    theta
        Parameters, shape (n_theta,).
    rule
        Where initial states come from, or the states themselves. States that are not measured, or only later than a
        twentieth of the log, start as declared or settled.
    follows
        For each log states that start where others lead them, as those behind a late sensor do.

    Raises
    ------
    EstimationError
        If the rule is not one of the three, or states are not given for every log.
    ModelError
        If a given state is not one of the model.
    """
    if not isinstance(rule, str):
        if len(rule) != len(logs):
            raise EstimationError(
                f"initial states: given for {len(rule)} logs of {len(logs)} - give one mapping per log"
            )
        return [_with_given(model, log, theta, given) for log, given in zip(logs, rule, strict=True)]
    own = start_rule(rule)
    if not own.measured:
        return [_with_given(model, log, theta, {}) for log in logs]
    starts = []
    for log, led in zip(logs, follows or [{}] * len(logs), strict=True):
        known = _known(model, log, theta)
        x0, held = _from_measurements(model, log, known, led)
        u = first_inputs(model, log)
        x0 = with_followers(model, x0, u, led)
        starts.append(settled(model, x0, u, known, held) if own.settled else x0)
    return starts


def at_parameters(
    model: Model, log: MatchedLog, theta: FloatArray, rule: Initial | Mapping[str, float], follows: Mapping[str, Follow]
) -> tuple[int, ...]:
    """The states of a log that start where parameters say: those that no measurement, rest or given value begins.

    ``rule`` holds the given states of this log where they are given; ``follows`` are states that others lead.
    """
    rows = [model.index("state", name) for name in model.parameter_starts]
    if not rows or rule == "settled":
        return ()
    elsewhere = {model.index("state", name) for name in (*follows, *(() if isinstance(rule, str) else rule))}
    if rule == "measured":
        held = _from_measurements(model, log, _known(model, log, theta), follows)[1]
        elsewhere |= set(map(int, np.flatnonzero(held)))
    return tuple(row for row in rows if row not in elsewhere)


def _known(model: Model, log: MatchedLog, theta: FloatArray) -> FloatArray:
    """Parameters (n_theta,), those that a log knows in their place."""
    known = theta.copy()
    for name, value in log.theta_overrides.items():
        known[model.index("parameter", name)] = value
    return known


def _with_given(model: Model, log: MatchedLog, theta: FloatArray, given: Mapping[str, float]) -> FloatArray:
    begun = model.x0(_known(model, log, theta))
    x0 = starts_in(model, log.time, inputs_of(model, log), log.y, begun)[0]
    rows = [model.index("state", name) for name in given]
    x0[rows] = list(given.values())
    return x0


def _from_measurements(
    model: Model, log: MatchedLog, theta: FloatArray, follows: Mapping[str, Follow]
) -> tuple[FloatArray, BoolArray]:
    """Initial state (n_x,), and which of its parts were measured; a start that is declared comes before others."""
    x0 = model.x0(theta)
    held = np.zeros(x0.size, dtype=np.bool_)
    while shown := first_shown(model, log, theta, follows, (x0, held)):
        for one in shown.values():  # it may tell a state that another output shows beside it
            x0[one.state] = one.value
            held[one.state] = True
    x0, given = starts_in(model, log.time, inputs_of(model, log), log.y, x0)
    return x0, held | given


def first_shown(
    model: Model,
    log: MatchedLog,
    theta: FloatArray,
    follows: Mapping[str, Follow] | None = None,
    known: tuple[FloatArray, BoolArray] | None = None,
) -> dict[int, OnCurve]:
    """The states that outputs show alone where a log begins, by output: on straight lines, and on curves.

    Arguments as for :func:`directly_measured`.
    """
    u = first_inputs(model, log)
    x0, held = (model.x0(theta), np.zeros(len(model.states), dtype=np.bool_)) if known is None else known
    measured = {o: value for o in range(len(model.outputs)) if (value := first_measured(log, o)) is not None}
    found = {
        o: OnCurve(state, (measured[o] - offset) / slope, slope, straight=True)
        for o, (state, slope, offset) in directly_measured(model, u, theta, follows, known).items()
        if o in measured
    }
    straight = {one.state for one in found.values()}
    left = {o: value for o, value in measured.items() if o not in found}
    curves = shown_by_curves(model, u, theta, left, (x0, held), follows)
    return found | {o: one for o, one in curves.items() if one.state not in straight}


def first_measured(log: MatchedLog, output: int) -> float | None:
    """The first value of an output, None where it is not measured near the beginning of the log."""
    early = log.time <= log.time[0] + BEGINNING * (log.time[-1] - log.time[0])
    first = np.flatnonzero(~np.isnan(log.y[output]) & early)
    return float(log.y[output, first[0]]) if first.size else None


def settled(model: Model, x0: FloatArray, u: FloatArray, theta: FloatArray, held: BoolArray) -> FloatArray:
    """Where the states that are not ``held`` (n_x,) come to rest while the others keep their values; shape (n_x,).

    A state that does not come to rest is held at its start too, and the others are settled anew.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = pendulum()
    >>> moving = settled(swing, np.array([0.3, 0.0]), swing.u0(), swing.theta(damping=8.0), np.array([False, False]))
    >>> bool(np.abs(moving).max() < 1e-4)
    True
    """
    kept = held.copy()
    while not kept.all():
        free = ~kept

        def rates(time: float, values: FloatArray, free: BoolArray = free) -> FloatArray:
            x = x0.copy()
            x[free] = values
            with np.errstate(all="ignore"):
                found: FloatArray = model.rhs(time, x, u, theta)[free]
            return found

        from scipy.integrate import solve_ivp  # a fifth of a second, for starts that settle only

        run = solve_ivp(rates, (0.0, _SETTLING), x0[free], method="LSODA", rtol=1e-8, atol=1e-10)
        ended = run.y[:, -1]
        if not (run.success and np.isfinite(ended).all()):
            return x0
        excursion = np.maximum(np.ptp(run.y, axis=1), 1e-6 * np.maximum(np.abs(ended), 1.0))
        restless = np.abs(rates(_SETTLING, ended)) * _SETTLING > 1e-2 * excursion
        if not restless.any():
            found = x0.copy()
            found[free] = ended
            return found
        kept[np.flatnonzero(free)[restless]] = True
    return x0


def directly_measured(
    model: Model,
    u: FloatArray,
    theta: FloatArray,
    follows: Mapping[str, Follow] | None = None,
    known: tuple[FloatArray, BoolArray] | None = None,
) -> dict[int, tuple[int, float, float]]:
    """Outputs that are slope * state + offset for one state only: output -> (state, slope, offset).

    Found by probing the output equations at states drawn around the declared ones; where two outputs measure the same
    state the first counts. States that follow others are where these lead them. Of states (n_x,) some may be ``known``:
    an output that shows another one beside them measures that.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> directly_measured(pendulum(), np.zeros(1), pendulum().theta())
    {}
    """
    size = len(model.states)
    middle, held = (model.x0(), np.zeros(size, dtype=np.bool_)) if known is None else known
    led = np.isin(model.names("state"), list(follows or {}))
    reach = np.where(led | held, 0.0, np.maximum(np.abs(middle), 1.0))
    rng = np.random.default_rng(0)
    probes = middle[:, np.newaxis] + reach[:, np.newaxis] * rng.uniform(-1.0, 1.0, (size, 4 * size + 8))
    if led.any():
        probes = np.array([with_followers(model, probe, u, follows or {}) for probe in probes.T]).T
    with np.errstate(all="ignore"):
        outputs = model.output(0.0, probes, u, theta)
    found: dict[int, tuple[int, float, float]] = {}
    for index, row in enumerate(outputs):
        if not np.isfinite(row).all():
            continue
        columns = np.vstack([np.where((led | held)[:, np.newaxis], 0.0, probes), np.ones(probes.shape[1])])
        coefficients = np.linalg.lstsq(columns.T, row)[0]
        straight = np.allclose(columns.T @ coefficients, row, rtol=1e-9, atol=1e-9 * np.ptp(row))
        acting = np.flatnonzero(np.abs(coefficients[:-1]) * reach > 1e-9 * max(float(np.ptp(row)), 1e-300))
        if (
            straight
            and np.ptp(row) > 0.0
            and acting.size == 1
            and acting[0] not in {state for state, _, _ in found.values()}
        ):
            found[index] = (int(acting[0]), float(coefficients[acting[0]]), float(coefficients[-1]))
    return found
