"""Free simulation of the declared model at its best: fitted without process noise.

The fit that candidates are scored on has process noise, which takes what the model lacks: its parameters are those of
the best filter. In free simulation they may be far behind what the declared model can do. An improvement is counted
from there in the tables, so that it must be said where another fit of the same model simulates much better.
"""

from __future__ import annotations

from bondgraph.correct.fits.assess import Assessment, assess
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.scores.quiet import quiet_fit
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.journal import Journal
from bondgraph.text import few, number

#: Share of the error before from which another fit of the declared model is clearly better: a convention.
_CLEARLY = 0.8


def simulated_better(nominal: Fit, before: tuple[Assessment, Assessment], journal: Journal | None) -> list[str]:
    """A sentence on channels that the declared model simulates much better where it is fitted without process noise.

    Parameters
    ----------
    nominal, before
        The fit of the declared model with its noise, and how it does on the training logs and on the held-out ones.
        The latter count where there are any.
    journal
        Finished fits; rounds look beneath the noise too. Of stiff models nothing is said: their fits are costly.
    """
    with_noise, which = (before[1], "held-out") if before[1].logs else (before[0], "training")
    if nominal.problem.filter_model.is_stiff:
        return []
    quiet = attempted(lambda: quiet_fit(nominal, nominal.problem.logs, journal), lambda why: None)
    logs = [one.log for one in with_noise.logs]
    after = None if quiet is None else attempted(lambda: assess(quiet, logs), lambda why: None)
    if after is None:
        return []
    said = []
    for info in nominal.problem.filter_model.model.outputs:
        if info.name not in with_noise.channels or info.name not in after.channels:
            continue
        pair = [one.channels[info.name].simulation_rmse for one in (after, with_noise)]
        if pair[0] < _CLEARLY * pair[1]:
            unit = f" {info.display_unit}" if info.display_unit not in ("", "1") else ""
            there, here = (number(float(info.shown(value))) for value in pair)
            said.append(f"{info.name} to {there}{unit}, where the table has {here} before")
    if not said:
        return []
    return [f"fitted without process noise the declared model itself simulates the {which} logs better: {few(said)}"]
