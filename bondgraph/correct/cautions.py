"""Cautions: open questions that the logs of a loop leave, whatever its verdict."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from bondgraph.correct.constants import BLOCKS
from bondgraph.correct.evidence.bounds import value_text
from bondgraph.correct.evidence.replaced import parameters_beside
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.gauge import told_together, unknown
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.progress import Progress
from bondgraph.correct.round import Round
from bondgraph.data.log import MatchedLog
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.simulate.late import late_rows
from bondgraph.simulate.model import Model
from bondgraph.text import few, inflected, number

#: Samples in a block of time below which it hardly counts as one.
_BLOCK_SAMPLES = 5
#: Standard deviations beyond which a value lies outside a 95 % interval of the normal distribution.
_OUTSIDE = 1.96


def cautions_of(nominal: Fit, rounds: Sequence[Round], corrected: Fit | None = None) -> tuple[str, ...]:
    """Sentences about parameters at bounds or unknown, short logs, and candidates that no sensor shows.

    Of a ``corrected`` model its own bounds are told: a parameter that left one beside its laws stood in for them.
    """
    said = []
    if not nominal.outcome.succeeded:
        said.append(f"the fit of the declared model ended early ({nominal.outcome.value}): take its numbers with care")
    loud = [
        parameter.target.name
        for parameter, resting in zip(nominal.problem.free, nominal.held, strict=True)
        if resting and parameter.target.kind == "std" and nominal.values[parameter.name] > parameter.start
    ]
    if loud:
        said.append(
            f"the declared model does not follow {', '.join(loud)} at all: the noise of "
            f"{inflected(loud, 'this sensor', 'each of these sensors')} rests on its upper bound"
        )
    seconds = sum(float(log.time[-1] - log.time[0]) for log in nominal.problem.logs)
    samples = sum(log.time.size for log in nominal.problem.logs)
    if samples < _BLOCK_SAMPLES * BLOCKS:
        said.append(
            f"{samples} samples in {seconds:.3g} s are few: tests that hold under coloured noise need blocks of time, "
            f"and see little with fewer than {_BLOCK_SAMPLES * BLOCKS}"
        )
    if corrected is None or corrected is nominal:  # else it is said of the corrected model
        said += at_bounds(nominal, "declared")
    said += _unknown(nominal, unknown(nominal))
    return (*said, *_undetectable(rounds))


def _unknown(fitted: Fit, names: Sequence[str]) -> list[str]:
    """Sentences on parameters of which the logs say next to nothing, or only how some act together.

    Standard deviations say nothing of a direction that is open to rounding.
    """
    together = told_together(fitted, names, 2)
    said = [f"in these logs {one}: fix one of them, or drive so that they act apart" for one in together]
    left = [name for name in names if not any(name in one.names for one in together)]
    if left:
        said.append(
            f"these logs say next to nothing about {', '.join(left)}: drive with more variety, or fix "
            f"{inflected(left, 'it', 'them')}"
        )
    return said


def at_bounds(fitted: Fit, which: str, known: Collection[str] | None = None) -> list[str]:
    """A sentence on the free parameters of a model that rest on bounds, each with its bound; none where none does.

    ``known``: names of those that are meant; None: all. A coefficient of an added law on zero is none of them.
    """
    names = [name for name in resting(fitted) if known is None or name in known]
    if not names:
        return []
    said = ", ".join(f"{name} ({value_text(fitted, name)})" for name in names)
    return [
        f"{said} {inflected(names, 'rests on its bound', 'rest on their bounds')} in the {which} model: the bounds are "
        f"too narrow, these logs hardly tell {inflected(names, 'it', 'them')}, or an effect is missing that "
        f"{inflected(names, 'it stands', 'they stand')} in for"
    ]


def left_bounds(name: str, fitted: Fit, laws: Sequence[Trial], declared: BondGraph) -> str:
    """A sentence on a parameter beyond its declared bounds, and the law that takes the place of its element."""
    labels = [one.candidate.label for one in laws if name in parameters_beside(one.candidate.place, declared)]
    value = f"{name} = {value_text(fitted, name)} is beyond its declared bounds"
    if not labels:
        return f"{value}, which it left beside a law that is gone"
    return (
        f"{value}: {few(labels)} {inflected(labels, 'takes', 'take')} the place of its element, which may be left out"
    )


def after_delays(laws: Sequence[Trial], fitted: Fit) -> list[str]:
    """A sentence on each delay of a sensor found before other laws, which may mend what its approximation leaves."""
    said = []
    for k, law in enumerate(laws):
        later = [one.candidate.label for one in laws[k + 1 :]]
        if law.candidate.effect.name == "sensor_delay" and later:
            time = fitted.values[law.candidate.effect.coefficients[0]]
            said.append(
                f"{law.candidate.label} is a delay by two states, right for slow changes alone: {few(later)}, found "
                f"after it, may mend what that leaves - shift the column by {time:.3g} s in the logs and close the "
                "loop again to see"
            )
    return said


def of_added(state: Progress, settled: Progress, journal: Journal | None) -> list[str]:
    """Sentences on the corrected model: on delays, on where it begins, and on events that its laws hang on.

    ``settled`` is the state in which the search ended, which holds events too.
    """
    said = [*after_delays(state.added, state.fit), *begun_with(state.built.model, state.train)]
    if state.laws:
        said += estimated_starts(state.fit)
    if state.laws and len(state.added) < len(settled.added):
        said += _hanging_on_events(state.fit, settled.fit, state.laws, journal)
    return said


def _hanging_on_events(alone: Fit, knowing: Fit, laws: Sequence[Trial], journal: Journal | None) -> list[str]:
    """A sentence on coefficients of laws that a fit without the events has outside their intervals.

    ``alone`` is the model without events, at the values that were estimated beside them in ``knowing``. Where an event
    stands for a part of a law, the law beside it is wrong by that part. None of stiff models: their fits are costly.
    """
    if alone.problem.filter_model.is_stiff:
        return []
    refitted = attempted(lambda: fit(alone.problem, journal=journal), lambda why: None)
    if refitted is None:
        return []
    moved = np.abs(refitted.point - alone.point)
    coefficients = [name for law in laws for name in law.candidate.effect.parameters if name in alone.problem.names]
    away = [name for name in coefficients if moved[alone.problem.names.index(name)] > _OUTSIDE * knowing.std[name]]
    if not away:
        return []
    told = few([f"{name} = {value_text(refitted, name)} instead of {value_text(alone, name)}" for name in away])
    return [
        f"a fit that knows of no event has {told}, and explains {refitted.nll - knowing.nll:.1f} nats less: where "
        "nothing happened to the machine, the event stands for a part of a law"
    ]


def estimated_starts(fitted: Fit) -> list[str]:
    """Sentences on states whose starts were estimated log by log, since the first measurements do not show them."""
    model, values, said = fitted.problem.filter_model.model, fitted.values, []
    for name in fitted.begun:
        info = model.states[model.index("state", name)]
        own = [one for one in fitted.problem.free if one.target.kind == "x0" and one.target.name == name]
        unit = f" {info.display_unit}" if info.display_unit not in ("", "1") else ""
        where = [f"{number(float(info.shown(values[one.name])))}{unit} in {one.target.log}" for one in own]
        said.append(
            f"{name} starts where the logs show it later on, {few(where)}: the corrected declaration has the mean"
        )
    return said


def begun_with(model: Model, logs: Sequence[MatchedLog]) -> list[str]:
    """A sentence on inputs that a model has late and that began with their logs: before these they count as nothing."""
    names = model.names("input")
    late = {names[row.source] for row in late_rows(model)}
    begun = sorted({name for log in logs for name in log.before if name in late})
    return [
        f"{name} begins with the logs: before them it is taken as {model.inputs[names.index(name)].default:g}, since "
        "the machine is at rest without it at the first sample"
        for name in begun
    ]


def resting(fitted: Fit) -> list[str]:
    """Names of the free parameters of a model that a fit leaves on a bound."""
    return [
        parameter.name
        for parameter, rests in zip(fitted.problem.free, fitted.held, strict=True)
        if rests and parameter.target.kind == "parameter"
    ]


def _undetectable(rounds: Sequence[Round]) -> list[str]:
    """Sentences on effects that the logs do not show, less those that a later round could see, or a law stands for."""
    seen = {(one.effect, one.junction) for turn in rounds for one in turn.detectable if np.isfinite(one.size)} | {
        (name, turn.chosen.candidate.place.label)
        for turn in rounds
        if turn.chosen
        for name in (turn.chosen.candidate.effect.described, turn.chosen.candidate.effect.name)  # everywhere, in part
    }
    seen |= {(one.name, one.junction) for turn in rounds for one in turn.alternatives if one.indistinguishable}
    blind = [one for one in (rounds[0].detectable if rounds else ()) if (one.effect, one.junction) not in seen]
    taken, small = ([f"{one.effect} at {one.junction}" for one in blind if one.taken is way] for way in (True, False))
    said = [f"cannot be told from what is free, whatever its size: {few(taken)}"] if taken else []
    if small:
        said.append(f"these logs would not show these, even as large as all else at their places: {few(small)}")
    return said
