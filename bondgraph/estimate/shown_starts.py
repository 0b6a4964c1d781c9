"""States that begin at what an output shows, where free parameters say what a state shows.

A heat q shows as the temperature q/C, a volume as a pressure, a speed through the scale of its sensor. The first
measurement says where the temperature begins, not the heat: that is C times as much, for every C that is tried. With
the heat of the declared C a search would take every other capacity for another temperature, and the declared one for
certain.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.free import Target
from bondgraph.estimate.initial import InitialRule, at_parameters, directly_measured, first_measured, first_shown
from bondgraph.estimate.likelihoods import Batch
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.rests import Rests, rests_of, shown_through
from bondgraph.estimate.shown_by_curves import FLAT, bends, inverted, single_state
from bondgraph.filter.follows import Follow
from bondgraph.simulate.late import first_inputs
from bondgraph.simulate.model import Model

#: A start that moves by less than this share of the largest slope does not follow: slopes are differences.
_TELLING = 1e-6
#: Slopes of what states at rest show are differences over this share of a parameter, the cube root of what is rounded.
_APART = 6e-6
#: Least size of a parameter in that share; what is smaller counts as zero, a convention.
_LEAST = 1e-12


@dataclass(frozen=True)
class ShownStart:
    """A state that begins where an output shows it: their positions, the first measurement, and the output's slope.

    The slope is that at the parameters at which the filter's uncertainty of the start was said. ``curved``: the output
    shows it by a curve, at these parameters or at others.
    """

    state: int
    output: int
    value: float
    slope: float
    curved: bool = False


@dataclass(frozen=True)
class ShownStarts:
    """How the states of a log begin that an output shows by a law with free parameters in it.

    ``model`` and ``log`` are what begins; ``shown`` the states; ``follows`` the other states that begin on a line in
    them, with their positions; ``at_parameters`` those that are declared to begin at an expression of parameters;
    ``rests`` those that begin at rest beside the others.
    """

    model: Model
    log: MatchedLog
    rests: Rests
    shown: tuple[ShownStart, ...]
    follows: tuple[tuple[int, Follow], ...] = ()
    at_parameters: tuple[int, ...] = ()

    @property
    def move(self) -> bool:
        """True where any of them depends on a parameter."""
        return bool(self.shown or self.at_parameters or self.rests.rows)

    def begun(self, theta: FloatArray, x0: FloatArray) -> FloatArray:
        """Initial states (n_x, members) at parameters (n_theta, members), others as in ``x0`` (n_x, members)."""
        if not self.move:
            return x0
        rows = list(self.at_parameters)
        moved = np.zeros_like(x0)
        with np.errstate(all="ignore"):
            x0 = self.rests.states(self._at(theta, x0))
            leads = self.rests.leads(self._at(theta, x0))
            if rows:
                moved[rows] = self.model.x0(self._at(theta, x0)[3])[rows] - x0[rows]
            if not self.shown:
                return x0 + self._followed(moved, leads)
            shows = self.model.output(*self._at(theta, x0))
            slopes = self._by_states(theta, x0)
            for one in self.shown:
                step = (one.value - shows[one.output]) / slopes[one.output, one.state]
                moved[one.state] = self._along_curve(one, theta, x0) if one.curved else step
        return x0 + self._followed(moved, leads)

    def _along_curve(self, one: ShownStart, theta: FloatArray, x0: FloatArray) -> FloatArray:
        """By how much (members,) a state is elsewhere where a curve shows it; zero where the curve does not tell."""

        def curve(moved: FloatArray) -> tuple[FloatArray, FloatArray]:
            away = np.zeros_like(x0)
            away[one.state] = moved
            there = x0 + self._followed(away, self.rests.leads(self._at(theta, x0)))
            shows = self.model.output(*self._at(theta, there))[one.output]
            return shows, self._by_states(theta, there)[one.output, one.state]

        found, slope = inverted(curve, np.zeros(x0.shape[1]), one.value)
        return np.where(np.isfinite(found) & (np.abs(slope) > FLAT * abs(one.slope)), found, 0.0)

    def widths(self, theta: FloatArray, x0: FloatArray) -> FloatArray:
        """How uncertain these states are, as multiples (n_x, members) of what was said: the output is as much as ever.

        Told in the state instead the likelihood would like outputs best that show little of it.
        """
        found = np.ones_like(x0)
        with np.errstate(all="ignore"):
            slopes = self._by_states(theta, x0)
            for one in self.shown:
                ratio = np.abs(one.slope / slopes[one.output, one.state])
                found[one.state] = np.where(ratio < 1.0 / FLAT, ratio, 1.0) if one.curved else ratio
        return found

    def as_said(self, one: ShownStart, theta: FloatArray) -> ShownStart:
        """A shown start with the slope of its output at parameters (n_theta,)."""
        x0 = self.model.x0(theta)
        slope = float(self._by_states(theta[:, np.newaxis], x0[:, np.newaxis])[one.output, one.state, 0])
        return replace(one, slope=slope) if np.isfinite(slope) and slope else one

    def slopes(self, theta: FloatArray, x0: FloatArray, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives (n_x, n) of both of the above by coordinates; ``turned`` (n_theta, n) are those of theta.

        ``theta`` (n_theta, 1) and ``x0`` (n_x, 1) are where the log begins. What an output shows of a state,
        h = s(theta) x + o(theta), stays as it is, so that dx/dtheta = -(dh/dtheta) / s.
        """
        moved, wider = np.zeros((2, x0.shape[0], turned.shape[1]))
        turned = turned.copy()
        turned[[self.model.index("parameter", name) for name in self.log.theta_overrides]] = 0.0
        if self.at_parameters:
            rows = list(self.at_parameters)
            moved[rows] = self.model.jacobian_theta(*self._at(theta, x0), "start")[rows, :, 0] @ turned
        leads, rested = self.rests.leads(self._at(theta, x0)), self.rests.by_coordinates(self._at(theta, x0), turned)
        for one in self.shown:
            away = np.zeros_like(x0)
            away[one.state] = 1.0
            with np.errstate(all="ignore"):
                by_state = float(self._by_states(theta, x0)[one.output, one.state, 0])
                if one.curved and not abs(by_state) > FLAT * abs(one.slope):
                    continue  # it tells nothing there, and the start stays
                here, there = (
                    self.model.jacobian_theta(*self._at(theta, at), "output")[one.output, :, 0] @ turned
                    for at in (x0, x0 + self._followed(away, leads))
                )
                alone = self.model.jacobian_x(*self._at(theta, x0), "output")[one.output, :, 0]
                moved[one.state] = -(here + alone[self.rests.own] @ rested) / by_state
                bent = there - here
                if self.rests.rows:
                    bent = self._bent(one, theta, x0, turned, moved)
                elif one.curved:
                    along = (self._followed(away, leads)[:, 0], moved[one.state])
                    bent = bends(self.model, self._at(theta, x0), (one.output, one.state), along, turned)
                wider[one.state] = -abs(one.slope / by_state) * bent / by_state
        moved = self._followed(moved, leads)
        moved[self.rests.own] += rested
        return moved, wider

    def _bent(
        self, one: ShownStart, theta: FloatArray, x0: FloatArray, turned: FloatArray, moved: FloatArray
    ) -> FloatArray:
        """Derivatives (n,) of an output's slope by coordinates, where states at rest show it; by differences."""
        size = np.max(np.abs(turned) / np.maximum(np.abs(theta), _LEAST), axis=0)
        step = _APART / np.where(size > 0.0, size, 1.0)
        leads = self.rests.leads(self._at(theta, x0))
        sides = (
            self._by_states(theta + side * turned, x0 + self._followed(side * moved, leads))[one.output, one.state]
            for side in (step, -step)
        )
        found: FloatArray = np.subtract(*sides) / (2.0 * step)
        return found

    def _at(self, theta: FloatArray, x0: FloatArray) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Arguments of equations at the first sample, parameters known for the log in their place."""
        own = theta.copy()
        for name, value in self.log.theta_overrides.items():
            own[self.model.index("parameter", name)] = value
        u = np.repeat(first_inputs(self.model, self.log)[:, np.newaxis], theta.shape[1], axis=1)
        return float(self.log.time[0]), x0, u, own

    def _by_states(self, theta: FloatArray, x0: FloatArray) -> FloatArray:
        """Derivatives of the outputs by the states (n_y, n_x, members), with what follows each of them."""
        names = self.model.names("state")
        alone = self.model.jacobian_x(*self._at(theta, x0), "output")
        found: FloatArray = alone + np.einsum(
            "orm,rjm->ojm", alone[:, self.rests.own], self.rests.leads(self._at(theta, x0))
        )
        for row, follow in self.follows:
            for name, slope in follow.slopes:
                if name in names:
                    found[:, names.index(name)] += slope * alone[:, row]
        return found

    def _followed(self, moved: FloatArray, leads: FloatArray) -> FloatArray:
        """Shifts (n_x, lanes) of states with those of what follows them; ``leads`` see :meth:`Rests.leads`."""
        names = self.model.names("state")
        for row, follow in self.follows:
            moved[row] = sum(slope * moved[names.index(name)] for name, slope in follow.slopes if name in names)
        moved[self.rests.own] = (leads * moved).sum(axis=1)
        return moved


@dataclass(frozen=True)
class Beginnings:
    """The beginnings of all logs of a problem; ``kept`` are states whose uncertainty is free itself."""

    logs: tuple[ShownStarts, ...]
    kept: tuple[int, ...] = ()

    @property
    def move(self) -> bool:
        """True where any of them depends on a parameter."""
        return any(one.move for one in self.logs)

    def of(self, members: Batch) -> Batch:
        """The members, each with its own beginnings."""
        if not self.move:
            return members
        pairs = zip(self.logs, members.x0, strict=True)
        begun = tuple(one.begun(members.theta, start) for one, start in pairs)
        for own, x0 in zip(self.logs, begun, strict=True):
            if own.shown:
                wider = self._wider(members.initial_std, own.widths(members.theta, x0))
                return replace(members, x0=begun, initial_std=wider)
        return replace(members, x0=begun)

    def slopes(self, here: Batch, said: FloatArray, turned: Batch) -> Batch:
        """Derivatives of :meth:`of` at one member; ``said`` (n_s, 1) is the uncertainty, ``turned`` all else's."""
        if not self.move:
            return turned
        pairs = list(zip(self.logs, here.x0, strict=True))
        own = [one.slopes(here.theta, start, turned.theta) for one, start in pairs]
        wider = next((slopes[1] for slopes, (one, _) in zip(own, pairs, strict=True) if one.shown), own[0][1])
        widths = turned.initial_std.copy()
        for row in np.flatnonzero(wider.any(axis=1)):
            if row not in self.kept:
                widths[row] = said[row] * wider[row]
        moved = tuple(start + slopes[0] for start, slopes in zip(turned.x0, own, strict=True))
        return replace(turned, x0=moved, initial_std=widths)

    def _wider(self, said: FloatArray, widths: FloatArray) -> FloatArray:
        found = said.copy()
        found[: widths.shape[0]] *= widths
        found[list(self.kept)] = said[list(self.kept)]
        return found


def led(model: Model, log: MatchedLog, theta: FloatArray, follows: Mapping[str, Follow]) -> Mapping[str, Follow]:
    """The states of a log that begin where others lead them: those of ``follows`` that no output shows alone.

    A state that an output shows is led, too, where nothing else shows what it follows: what a thermometer in a well
    shows is the temperature of the body at first.
    """
    names = model.names("state")
    known = [name for name in follows if name in names]
    shown = {names[one.state] for one in first_shown(model, log, theta).values()} if known else set()
    return {name: follows[name] for name in known if name not in shown or _is_of_hidden(follows[name], names, shown)}


def _is_of_hidden(follow: Follow, states: Sequence[str], shown: Collection[str]) -> bool:
    """True for a state that follows one that no output shows; differences leave what is far below the largest slope."""
    largest = max((abs(slope) for _, slope in follow.slopes), default=0.0)
    return any(
        name in states and name not in shown and abs(slope) > _TELLING * largest for name, slope in follow.slopes
    )


def shown_starts(
    model: Model,
    log: MatchedLog,
    theta: FloatArray,
    moved: Collection[Target],
    follows: Mapping[str, Follow],
    rule: InitialRule | Mapping[str, float] = "measured",
) -> ShownStarts:
    """The states of a log that begin where parameters say: at a measurement that these translate, or at an expression.

    Parameters
    ----------
    model, log
        What begins.
    theta
        Parameters (n_theta,) where searches start.
    moved
        What may move; an initial state that does begins neither at a measurement nor at an expression.
    follows
        States that begin where others lead them, see :func:`led`.
    rule
        Where initial states of the log come from.
    """
    own, said = {model.index("parameter", one.name) for one in moved if one.kind == "parameter"}, model.theta()
    begun = _free_starts(log, moved)
    rests = rests_of(model, own, [name for name, one in follows.items() if one.rests and name not in begun])
    rows = {name: model.index("state", name) for name in follows if name not in begun}
    lines = tuple((row, follows[name]) for name, row in rows.items() if row not in rests.rows)
    declared = [k for k in at_parameters(model, log, theta, rule, follows) if model.states[k].name not in begun]
    moving = _moving(model, own, declared)
    found: list[ShownStart] = []
    translated = shown_through(model, own, rests) if own and rule in ("measured", "settled") else set()
    if translated:
        away = directly_measured(model, first_inputs(model, log), _moved(model, own), follows)
        straight = {output: state for output, (state, _, _) in away.items()}
        here = [one for one in _begun_at_outputs(model, log, said, moved, follows) if one.output in translated]
        found = list(filter(None, (_anywhere(one, model, straight.get(one.output), follows) for one in here)))
    starts = ShownStarts(model, log, rests, tuple(found), lines if found or moving else (), moving)
    return replace(starts, shown=tuple(starts.as_said(one, said) for one in found)) if rests.rows else starts


def _anywhere(one: ShownStart, model: Model, straight: int | None, follows: Mapping[str, Follow]) -> ShownStart | None:
    """A shown start as it is at other parameters too, or None where other states act there.

    ``straight`` is the state that its output shows by a line at these parameters.
    """
    if not one.curved and straight == one.state:
        return one
    alone = single_state(model, one.output, np.zeros(len(model.states), dtype=np.bool_), follows)
    return replace(one, curved=True) if alone == one.state else None


def _moving(model: Model, own: Collection[int], rows: Sequence[int]) -> tuple[int, ...]:
    """The states of some rows whose start depends on any of some parameters."""
    if not rows or not own:
        return ()
    jacobian = model.program.jacobian("start", "theta")
    pairs = zip(map(int, jacobian.rows), map(int, jacobian.columns), strict=True)
    told = {row for row, column in pairs if column in own}
    return tuple(row for row in rows if row in told)


def start_shifts(
    model: Model, log: MatchedLog, theta: FloatArray, free: Collection[Target], follows: Mapping[str, Follow]
) -> FloatArray:
    """Shifts (n_x, n_y) of the initial states of a log where an output shows a unit more of the same states.

    What was measured stays, so that the state is less by as much. Arguments as for :func:`shown_starts`, with
    parameters theta (n_theta,).
    """
    shifts, names = np.zeros((len(model.states), len(model.outputs))), model.names("state")
    begun = _free_starts(log, free)
    for one in _begun_at_outputs(model, log, theta, free, follows):
        shifts[one.state, one.output] = -1.0 / one.slope
    for name, follow in follows.items():
        if name not in begun:
            known = [(slope, names.index(other)) for other, slope in follow.slopes if other in names]
            shifts[names.index(name)] = sum((slope * shifts[row] for slope, row in known), np.zeros(shifts.shape[1]))
    return shifts


def _moved(model: Model, rows: Collection[int]) -> FloatArray:
    """Parameters (n_theta,) of which those in some rows are half-way to their larger bound, or half as large again."""
    theta = model.theta()
    for row in rows:
        info = model.parameters[row]
        theta[row] = 1.5 * theta[row] if info.upper is None else 0.5 * (theta[row] + info.upper)
    return theta


def _free_starts(log: MatchedLog, free: Collection[Target]) -> set[str]:
    return {one.name for one in free if one.kind == "x0" and one.log in (None, log.name)}


def _begun_at_outputs(
    model: Model, log: MatchedLog, theta: FloatArray, free: Collection[Target], follows: Mapping[str, Follow]
) -> list[ShownStart]:
    """The states that begin at a measurement: neither free nor declared to begin elsewhere."""
    elsewhere = {
        model.index("state", name) for name in (*_free_starts(log, free), *(one.state for one in model.starts))
    }
    found = []
    for output, one in first_shown(model, log, theta, follows).items():
        value = first_measured(log, output)
        if one.state not in elsewhere and value is not None:
            found.append(ShownStart(one.state, output, value, one.slope, not one.straight))
    return found
