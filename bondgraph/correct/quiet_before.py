"""Free simulation of the declared model at its best: fitted without process noise.

The fit that candidates are scored on has process noise, which takes what the model lacks: its parameters are those of
the best filter. In free simulation they may be far behind what the declared model can do. An improvement is counted
from there in the tables, where models with noise stand beside models with noise. So it must be said where another fit
of the declared model simulates much better, and above all where it does better than the corrected one.
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


def simulated_better(
    nominal: Fit, before: tuple[Assessment, Assessment], after: tuple[Assessment, Assessment], journal: Journal | None
) -> list[str]:
    """A sentence on channels that the declared model simulates much better where it is fitted without process noise.

    Parameters
    ----------
    nominal, before, after
        The fit of the declared model with its noise, how it does on the training logs and on the held-out ones, and how
        the corrected model does. The held-out ones count where there are any.
    journal
        Finished fits; rounds look beneath the noise too. Of stiff models nothing is said: their fits are costly.
    """
    which = 1 if before[1].logs else 0
    with_noise, corrected = before[which], after[which]
    if nominal.problem.filter_model.is_stiff:
        return []
    quiet = attempted(lambda: quiet_fit(nominal, nominal.problem.logs, journal), lambda why: None)
    logs = [one.log for one in with_noise.logs]
    best = None if quiet is None else attempted(lambda: assess(quiet, logs), lambda why: None)
    if best is None:
        return []
    said, beaten = [], False
    for info in nominal.problem.filter_model.model.outputs:
        if any(info.name not in one.channels for one in (best, with_noise, corrected)):
            continue
        errors = [one.channels[info.name].simulation_rmse for one in (best, with_noise, corrected)]
        if errors[0] < _CLEARLY * errors[1]:
            unit = f" {info.display_unit}" if info.display_unit not in ("", "1") else ""
            there, here, last = (number(float(info.shown(value))) for value in errors)
            said.append(f"{info.name} to {there}{unit} instead of {here} (corrected: {last})")
            beaten = beaten or errors[0] < errors[2]
    if not said:
        return []
    also = ", and better than the corrected model does" if beaten else ""
    kind = ("training", "held-out")[which]
    return [
        f"the declared model simulates the {kind} logs better where it is fitted without process noise{also}: "
        f"{few(said)}"
    ]
