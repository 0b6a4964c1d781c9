"""An estimate on logs that it has not seen: likelihood, consistency and errors beside those at the declared values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bondgraph.arrays import FloatArray
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.free_simulation import left_alone
from bondgraph.estimate.initial import initial_states
from bondgraph.estimate.inputs_before import with_inputs_before
from bondgraph.estimate.result import Estimate
from bondgraph.filter.consistency import consistency
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.runs import run
from bondgraph.report.collect import Runs, channel_series
from bondgraph.report.series import ChannelError, ChannelSeries, channel_errors
from bondgraph.simulate.outcome import Outcome
from bondgraph.text import number, text_table


@dataclass(frozen=True)
class HeldOutLog:
    """One held-out log.

    Parameters
    ----------
    name
        Of the log.
    declared_nll, nll
        Negative log-likelihood at the declared parameters, and at the estimated ones; both with the estimated noises.
    nis_mean, nis_band
        Mean normalised innovation squared at the estimate, and its 95 % band.
    series
        Measured channels with what the model says of them, at the declared parameters before and at the estimate after.
    """

    name: str
    declared_nll: float
    nll: float
    nis_mean: float
    nis_band: tuple[float, float]
    series: tuple[ChannelSeries, ...] = ()

    @property
    def errors(self) -> tuple[ChannelError, ...]:
        """Errors of each channel: free simulations start where the beginning of a log shows."""
        return channel_errors(self.series)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it; numbers that do not exist are null."""
        numbers = {"declared_nll": self.declared_nll, "nll": self.nll, "nis_mean": self.nis_mean}
        channels = {
            one.channel: {
                "unit": one.unit,
                **_finite({
                    "declared_simulation_rmse": one.simulation_before, "simulation_rmse": one.simulation_after,
                    "noise_std": one.noise_std,
                }),
            }
            for one in self.errors
        }  # fmt: skip
        band = [end if math.isfinite(end) else None for end in self.nis_band]
        return {"log": self.name, **_finite(numbers), "nis_band": band, "channels": channels}


def _finite(numbers: dict[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in numbers.items()}


def held_out_logs(fit: Estimate, logs: Sequence[MatchedLog]) -> tuple[HeldOutLog, ...]:
    """How an estimate of one filter model does on logs that it has not seen.

    Raises
    ------
    EstimationError
        If it is an estimate of a joint problem.
    """
    filter_model, model = fit.filter_model, fit.filter_model.model
    found = []
    for log in with_inputs_before(model, logs, model.theta(), _rule(fit)):
        declared, estimated = (
            run(filter_model, log, theta, x0=initial_states(model, [log], theta, _rule(fit))[0])
            for theta in (model.theta(), fit.theta)
        )
        series = channel_series(
            model, log, _runs(declared, model.theta(), log), _runs(estimated, fit.theta, log),
            dict(zip(model.names("output"), filter_model.noise_std, strict=True)), held_out=True,
        )  # fmt: skip
        nis, band = math.nan, (math.nan, math.nan)
        if math.isfinite(estimated.nll):
            seen = consistency(estimated)
            nis, band = seen.nis_mean, seen.nis_band
        found.append(HeldOutLog(log.name, declared.nll, estimated.nll, nis, band, series))
    return tuple(found)


def _runs(filtered: FilterRun, theta: FloatArray, log: MatchedLog) -> Runs:
    """A filter's run with the free simulation beside it; none of a run that failed or a model that does."""
    if filtered.outcome is not Outcome.OK:
        return Runs()
    simulated = left_alone(filtered, theta, log)
    return Runs(filtered, simulated if simulated.outcome is Outcome.OK else None)


def _rule(fit: Estimate) -> Any:
    """Where held-out logs start: by the rule of the estimate; by measurements where states were given for its logs."""
    rule = fit.single.initial
    return rule if isinstance(rule, str) else "measured"


def held_out_table(found: Sequence[HeldOutLog]) -> str:
    """A line for each log.

    Examples
    --------
    >>> print(held_out_table([HeldOutLog("run7", 120.0, 80.0, 1.02, (0.9, 1.1))]))
    held out      NLL declared  estimated  NIS                95 % band
    run7               120         80      1.02  0.9 to 1.1
    """
    rows = [
        [one.name, *map(number, (one.declared_nll, one.nll, one.nis_mean)), " to ".join(map(number, one.nis_band))]
        for one in found
    ]
    return text_table(("held out", "NLL declared", "estimated", "NIS", "95 % band"), rows)
