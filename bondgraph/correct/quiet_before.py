"""Free simulation of the declared model at its best: fitted without process noise.

The fit that candidates are scored on has process noise, which takes what the model lacks: its parameters are those of
the best filter. In free simulation they may be far behind what the declared model can do. An improvement that is
counted from there flatters, so that errors of free simulation before are those of the fit that simulates better.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bondgraph.correct.fits.assess import Assessment, LogAssessment, assess
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.scores.quiet import quiet_fit
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.journal import Journal
from bondgraph.text import few, number

#: Share of the error before from which another fit of the declared model is clearly better: a convention.
_CLEARLY = 0.8


def simulated_at_best(
    nominal: Fit, before: tuple[Assessment, Assessment], journal: Journal | None
) -> tuple[tuple[Assessment, Assessment], list[str]]:
    """Errors of the declared model, those of free simulation by the fit that simulates better, and a sentence on that.

    Parameters
    ----------
    nominal, before
        The fit of the declared model with its noise, and how it does on the training logs and on the held-out ones.
        Which fit simulates better is decided on the training logs.
    journal
        Finished fits; rounds look beneath the noise too. Of stiff models no other fit is made: it is costly.
    """
    if nominal.problem.filter_model.is_stiff:
        return before, []
    quiet = attempted(lambda: quiet_fit(nominal, nominal.problem.logs, journal), lambda why: None)
    parts = None if quiet is None else attempted(lambda: _both(quiet, before), lambda why: None)
    if parts is None or not _ratio(before[0], parts[0]) < _CLEARLY:
        return before, []
    told = parts[1] if before[1].logs else parts[0]
    own = before[1] if before[1].logs else before[0]
    said = []
    for info in nominal.problem.filter_model.model.outputs:
        if info.name in own.channels:
            here, there = (number(float(info.shown(one.channels[info.name].simulation_rmse))) for one in (own, told))
            unit = f" {info.display_unit}" if info.display_unit not in ("", "1") else ""
            said.append(f"{info.name} {there}{unit} instead of {here}")
    which = "held-out" if before[1].logs else "training"
    return (_simulated(before[0], parts[0]), _simulated(before[1], parts[1])), [
        "errors of free simulation before are those of the declared model fitted without process noise, which "
        f"simulates better than with it: {few(said)} on the {which} logs"
    ]


def _both(quiet: Fit, before: tuple[Assessment, Assessment]) -> tuple[Assessment, Assessment]:
    train, holdout = (assess(quiet, [one.log for one in part.logs]) for part in before)
    return train, holdout


def _ratio(before: Assessment, other: Assessment) -> float:
    """How many times as large errors of free simulation are by another fit: the geometric mean over the channels."""
    pairs = [(one.simulation_rmse, other.channels[name].simulation_rmse) for name, one in before.channels.items()]
    logarithms = [math.log(last / first) for first, last in pairs if 0.0 < first < math.inf and last > 0.0]
    return math.exp(float(np.mean(logarithms))) if logarithms else 1.0


def _simulated(before: Assessment, other: Assessment) -> Assessment:
    """An assessment with the free simulations of another one."""
    return Assessment(tuple(_with_run(own, better) for own, better in zip(before.logs, other.logs, strict=True)))


def _with_run(own: LogAssessment, better: LogAssessment) -> LogAssessment:
    channels = {
        name: replace(
            error,
            simulation_rmse=better.channels[name].simulation_rmse,
            simulation_ci95=better.channels[name].simulation_ci95,
        )
        for name, error in own.channels.items()
    }
    return replace(own, channels=channels, simulated=better.simulated)
