"""Answer of held-out logs to a correction, in sentences that agree with the table of errors."""

from __future__ import annotations

import math
from collections.abc import Mapping

from bondgraph.correct.confirmation import Confirmation
from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.fits.assess import ChannelError
from bondgraph.correct.loop import ClosedLoop
from bondgraph.report.numbers import shown
from bondgraph.text import few

#: Percent by which the error of a free simulation must grow to be said beside a confirmation.
_CLEARLY = 5
#: Times the noise from which a free simulation is far off: three quarters of its mean square are then no noise.
_FAR = 2.0


def held_out(closed: ClosedLoop, told: Confirmation) -> str:
    """The answer of the logs to what was added, with its numbers."""
    added = _added(closed)
    what = {
        "confirmed": f"The held-out logs confirm the {added}",
        "contradicted": f"The logs contradict the {added}",
        "open": f"The held-out logs neither confirm nor contradict the {added}",
    }[told.standing]
    if told.standing == "confirmed" and clearly_worse(closed):
        what = f"{what} one step ahead, but not in free simulation"
    how = "noise levels scaled to these logs, standard error by blocks of time"
    noise = f"innovations there are {shown(told.noise)} times as large as the corrected model expects"
    against = [f"{one}; " for one in told.contradictions if "log-likelihood" not in one]
    said = f"{what}: {''.join(against)}{_changed(told)} ({how}); {noise}. Held-out logs decided nothing."
    return said if told.contradictions else f"{said}{_wandering(closed) or _far_off(closed, told)}"


def _added(closed: ClosedLoop) -> str:
    """The word for what was added."""
    if closed.added:
        return "correction"
    return "estimated constants" if closed.constants and not closed.disturbances else "disturbance"


def _changed(told: Confirmation) -> str:
    """Words on what the correction gains on held-out logs; beside a disturbance on what its laws alone gain, first."""
    within = f" ± {shown(told.error)}" if math.isfinite(told.error) else ""
    whole = f"by {shown(told.gain)}{within} nats"
    if told.laws is None:
        return f"the log-likelihood of the held-out logs changes {whole}"
    laws = f"by {shown(told.laws.gain)} ± {shown(told.laws.error)} nats"
    if laws == whole:
        return f"the laws change the log-likelihood of the held-out logs {laws}; the disturbance adds nothing"
    return (
        f"the laws change the log-likelihood of the held-out logs {laws} beside the disturbance, which is in both "
        f"models then; together with it they change it {whole}"
    )


def worse_simulated(closed: ClosedLoop) -> list[str]:
    """Sentences for the headline, where free simulation of logs gets clearly worse by what was added.

    Of training logs where the noise of the sensor is left behind, too.
    """
    if closed.verdict == "effect not confirmed" or not (closed.added or closed.disturbances or closed.constants):
        return []
    what, last = _added(closed), closed.corrected_train.channels
    grown = _grown(closed.nominal_train.channels, last)
    seen = [name for name in grown if last[name].simulation_rmse > _FAR * _noise(closed, name, last[name].noise_std)]
    training = [f"{name} (+{grown[name]} %)" for name in seen if grown[name] > _CLEARLY]
    kinds = {"held-out": clearly_worse(closed), "training": training}
    return [
        f"Free simulation of the {kind} logs is worse with the {what}: {few(worse)}."
        for kind, worse in kinds.items()
        if worse
    ]


def clearly_worse(closed: ClosedLoop) -> list[str]:
    """Channels whose free simulation on held-out logs gets worse by more than a few percent, with how much."""
    grown = _grown(closed.nominal_holdout.channels, closed.corrected_holdout.channels)
    return [f"{name} (+{percent} %)" for name, percent in grown.items() if percent > _CLEARLY]


def _grown(before: Mapping[str, ChannelError], after: Mapping[str, ChannelError]) -> dict[str, int]:
    """Growth of the errors of free simulation in percent, as the table shows it; those that grow."""
    return {
        name: round(100.0 * (one.simulation_rmse / before[name].simulation_rmse - 1.0)) for name, one in after.items()
        if 0.0 < before[name].simulation_rmse < one.simulation_rmse < math.inf
    }  # fmt: skip


def _far_off(closed: ClosedLoop, told: Confirmation) -> str:
    """A sentence on free simulation that stays far above the noise of sensors where a correction is confirmed."""
    if told.standing != "confirmed" or not (closed.added or closed.disturbances):
        return ""
    far = _far(closed, closed.corrected_holdout.channels)
    if not far:
        return ""
    if closed.disturbances:
        return (
            f" Free simulation stays far from {few(list(far))} there: what drives the machine at random may hide a law."
        )
    return f" Free simulation stays above the noise of {_times(far)} there: not everything is explained."


def driven_at_random(closed: ClosedLoop) -> list[str]:
    """A sentence for the headline, where nothing was found and process noise bridges what simulation leaves."""
    if closed.added or closed.disturbances or closed.constants or not closed.corrected.driven > INDIFFERENT:
        return []
    far = _far(closed, closed.corrected_train.channels)
    if not far:
        return []
    return [
        f"Yet free simulation of the training logs stays above the noise of {_times(far)}, and process noise makes "
        "good for that: something drives the machine at random, or by a law that none of those tried is like."
    ]


def _far(closed: ClosedLoop, channels: Mapping[str, ChannelError]) -> dict[str, float]:
    """Errors of free simulation in times the noise of the sensor, of channels that are far off."""
    noise = {name: _noise(closed, name, one.noise_std) for name, one in channels.items()}
    return {
        name: one.simulation_rmse / noise[name] for name, one in channels.items()
        if noise[name] > 0.0 and _FAR * noise[name] < one.simulation_rmse < math.inf
    }  # fmt: skip


def _times(far: Mapping[str, float]) -> str:
    return few([f"{name} ({shown(times)} times)" for name, times in far.items()])


def _noise(closed: ClosedLoop, channel: str, white: float) -> float:
    """Standard deviation of all noise of a sensor, in its coherent unit: the white part, and what has a memory."""
    own = [one.size for one in closed.disturbances if one.trial.candidate.effect.channel == channel]
    if not own:
        return white
    model = closed.corrected.problem.filter_model.model
    info = model.outputs[model.index("output", channel)]
    return math.hypot(white, *(size / (info.shown(1.0) - info.shown(0.0)) for size in own))


def _wandering(closed: ClosedLoop) -> str:
    """A sentence on free simulation that gets worse beside a likelihood that does not; empty where none does."""
    grown = _grown(closed.nominal_holdout.channels, closed.corrected_holdout.channels)
    worse = [f"{name} (+{percent} %)" for name, percent in grown.items() if percent]
    if worse and closed.corrected.driven > INDIFFERENT:
        return (
            f" Free simulation is worse there in {few(worse)}: it does not follow what drives the machine at random, "
            "so that one-step errors tell more."
        )
    worse = clearly_worse(closed)
    if not worse:
        return ""
    return (
        f" Free simulation is worse there in {few(worse)}: it predicts the next sample better and the course of a "
        "whole log worse, so that it is no model to simulate with."
    )
