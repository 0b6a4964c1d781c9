"""Answer of held-out logs to a correction, in sentences that agree with the table of errors."""

from __future__ import annotations

import math

from bondgraph.correct.confirmation import Confirmation
from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.loop import ClosedLoop
from bondgraph.report.numbers import shown
from bondgraph.text import few


def held_out(closed: ClosedLoop, told: Confirmation) -> str:
    """The answer of the logs to what was added, with its numbers."""
    added = "correction" if closed.added else "disturbance"
    what = {
        "confirmed": f"The held-out logs confirm the {added}",
        "contradicted": f"The logs contradict the {added}",
        "open": f"The held-out logs neither confirm nor contradict the {added}",
    }[told.standing]
    within = f" ± {shown(told.error)}" if math.isfinite(told.error) else ""
    changed = f"the log-likelihood of the held-out logs changes by {shown(told.gain)}{within} nats"
    how = "noise levels scaled to these logs, standard error by blocks of time"
    noise = f"innovations there are {shown(told.noise)} times as large as the corrected model expects"
    against = [f"{one}; " for one in told.contradictions if "log-likelihood" not in one]
    said = f"{what}: {''.join(against)}{changed} ({how}); {noise}. Held-out logs decided nothing."
    return said if told.contradictions else f"{said}{_wandering(closed)}"


def _wandering(closed: ClosedLoop) -> str:
    """A sentence on free simulation that gets worse beside a likelihood that does not; empty where none does."""
    before, after = closed.nominal_holdout.channels, closed.corrected_holdout.channels
    grown = {
        name: round(100.0 * (one.simulation_rmse / before[name].simulation_rmse - 1.0)) for name, one in after.items()
        if 0.0 < before[name].simulation_rmse < one.simulation_rmse < math.inf
    }  # fmt: skip
    worse = [f"{name} (+{percent} %)" for name, percent in grown.items() if percent]  # as the table shows them
    if not worse or closed.corrected.driven <= INDIFFERENT:
        return ""
    return (
        f" Free simulation is worse there in {few(worse)}: it does not follow what drives the machine at random, "
        "so that one-step errors tell more."
    )
