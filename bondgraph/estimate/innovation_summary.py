"""What the filter's innovations say at an estimate, per output over all logs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bondgraph.estimate.result import Estimate
from bondgraph.filter.consistency import nis_band, normalised_innovations, whiteness_p
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.runs import run

#: Missing samples put between logs, so that no autocorrelation reaches from one into the next.
_APART = 50


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
    model = fit.filter_model
    logs = fit.problem.logs
    return tuple(run(model, log, fit.theta, compiled=compiled, x0=x0) for log, x0 in zip(logs, fit.x0, strict=True))


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
    good = [one for one in runs if math.isfinite(one.nll)]
    if not good:
        return {}
    normalised = [normalised_innovations(one) for one in good]
    gap = np.full((normalised[0].shape[0], _APART), np.nan)
    joined = np.concatenate([part for one in normalised for part in (one, gap)], axis=1)
    errors = np.concatenate([one.innovation for one in good], axis=1)
    summary: dict[str, dict[str, Any]] = {}
    for row, info in enumerate(good[0].filter_model.model.outputs):
        count = int(np.sum(~np.isnan(joined[row])))
        if count:
            white = whiteness_p(joined[row])
            summary[info.name] = {
                "unit": info.display_unit,
                "rmse": info.shown(float(np.sqrt(np.nanmean(errors[row] ** 2)))),
                "nis_mean": float(np.nanmean(joined[row] ** 2)),
                "nis_band": list(nis_band(count, count)),
                "whiteness_p": white if math.isfinite(white) else None,
            }
    return summary
