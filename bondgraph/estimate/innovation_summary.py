"""What the filter's innovations say at an estimate, per output over all logs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bondgraph.estimate.result import Estimate
from bondgraph.filter.consistency import joined_innovations, nis_band, whiteness_p
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.runs import run


def fitted_runs(fit: Estimate, *, compiled: bool = True) -> tuple[FilterRun, ...]:
    """Filter every log of an estimation with the estimated numbers.

    Parameters
    ----------
    fit
        The estimate.
    compiled
        Use the compiled filter.

    Returns
    -------
    tuple[FilterRun, ...]
        One per log, in their order.
    """
    if compiled:
        return fit.runs
    logs = zip(fit.problem.logs, fit.x0, strict=True)
    return tuple(run(fit.filter_model, log, fit.theta, compiled=compiled, x0=x0) for log, x0 in logs)


def innovation_summary(runs: tuple[FilterRun, ...]) -> dict[str, dict[str, Any]]:
    """What ``result.json`` says of each measured output over all logs.

    Parameters
    ----------
    runs
        As :func:`fitted_runs` gives them; runs that failed are left out.

    Returns
    -------
    dict
        ``unit``, ``rmse``, ``nis_mean``, ``nis_band`` and ``whiteness_p`` by output; ``rmse`` in the unit in which
        the output is shown; numbers that do not exist are None.
    """
    summary: dict[str, dict[str, Any]] = {}
    for channel in joined_innovations([one for one in runs if math.isfinite(one.nll)]):
        white = whiteness_p(channel.normalised)
        outputs = runs[0].filter_model.model
        info = outputs.outputs[outputs.index("output", channel.name)]
        summary[channel.name] = {
            "unit": info.display_unit,
            "rmse": info.shown(channel.rmse),
            "nis_mean": float(np.nanmean(channel.normalised**2)),
            "nis_band": list(nis_band(channel.count, channel.count)),
            "whiteness_p": white if math.isfinite(white) else None,
        }
    return summary
