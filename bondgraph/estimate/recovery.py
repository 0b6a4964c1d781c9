"""Does an estimator find the truth? Estimates from many simulated logs against the values that made them.

An estimator is unbiased for a parameter where the mean error over repetitions lies within what chance explains, and its
intervals are honest where 95 % of them hold the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import BoolArray, FloatArray
from bondgraph.estimate.result import Estimate

#: Mean errors beyond this many of their standard errors are called bias.
_BIASED = 2.0


@dataclass(frozen=True)
class Trial:
    """One repetition, as plain values that a JSON file can hold: everything by name and in the model's units.

    ``nll_at_truth`` is the negative log-likelihood of the true values, ``shift`` how many standard deviations finer
    integration steps would move an estimate (None: not looked at), ``cpu`` the processor time if it was taken;
    ``failure`` is empty where the search succeeded, else its message.
    """

    truth: Mapping[str, float]
    values: Mapping[str, float]
    std: Mapping[str, float]
    ci95: Mapping[str, tuple[float, float]]
    nll: float
    evaluations: int
    seconds: float
    failure: str = ""
    nll_at_truth: float | None = None
    shift: float | None = None
    cpu: float | None = None

    @classmethod
    def of(cls, estimate: Estimate, truth: Mapping[str, float]) -> Trial:
        """The trial that an estimate is, given the true values of what was free."""
        shift = float(estimate.certification.shift) if estimate.certification.checks else None
        known = {name: float(truth[name]) for name in estimate.problem.names}
        point = np.array([free.coordinate(known[free.name]) for free in estimate.problem.free])
        at_truth = float(estimate.problem.nll(point[:, np.newaxis])[0])
        failure = "" if estimate.outcome.succeeded else estimate.outcome.value
        return cls(
            known, dict(estimate.values), dict(estimate.std), dict(estimate.ci95),
            float(estimate.nll), estimate.evaluations, estimate.seconds, failure, at_truth, shift,
        )  # fmt: skip


@dataclass(frozen=True)
class ParameterRecovery:
    """How one parameter was recovered, in its own unit.

    Parameters
    ----------
    name
        Its name.
    truth
        Mean of the true values over the repetitions.
    mean_error
        Mean of estimate minus truth.
    standard_error
        Standard error of that mean.
    scatter
        Standard deviation of the errors.
    stated
        Root mean square of the standard deviations that the estimates state.
    coverage
        Share of the 95 % intervals that hold the truth.
    repetitions
        How many estimates counted.
    """

    name: str
    truth: float
    mean_error: float
    standard_error: float
    scatter: float
    stated: float
    coverage: float
    repetitions: int

    @property
    def in_standard_errors(self) -> float:
        """The mean error in units of its standard error."""
        return self.mean_error / self.standard_error if self.standard_error > 0.0 else float("nan")

    @property
    def biased(self) -> bool:
        """Whether the mean error is more than two of its standard errors."""
        return abs(self.in_standard_errors) > _BIASED


@dataclass(frozen=True)
class Recovery:
    """All parameters, the share of all intervals that hold the truth, and the repetitions that failed, with why."""

    parameters: tuple[ParameterRecovery, ...]
    coverage: float
    failures: tuple[str, ...]

    def parameter(self, name: str) -> ParameterRecovery:
        """The parameter called ``name``.

        Raises
        ------
        EstimationError
            If it was not estimated.
        """
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise EstimationError(
            f"{name!r} was not estimated - there are {', '.join(parameter.name for parameter in self.parameters)}",
            where=(name,),
        )


def recovery(trials: Sequence[Trial]) -> Recovery:
    """Compare estimates with the truth behind each.

    Parameters
    ----------
    trials
        One per repetition, of the same free parameters.

    Raises
    ------
    EstimationError
        If fewer than two estimates succeeded, which says nothing about scatter.
    """
    good = [trial for trial in trials if not trial.failure]
    failures = tuple(f"repetition {n}: {trial.failure}" for n, trial in enumerate(trials, start=1) if trial.failure)
    if len(good) < 2:
        raise EstimationError(
            f"{len(good)} of {len(trials)} estimates succeeded - at least two are needed"
            + (f"; first failure: {failures[0]}" if failures else "")
        )
    rows, held = [], []
    for name in good[0].values:
        true = np.array([trial.truth[name] for trial in good])
        error = np.array([trial.values[name] for trial in good]) - true
        bounds = np.array([trial.ci95[name] for trial in good])
        inside = (bounds[:, 0] <= true) & (true <= bounds[:, 1])
        held.append(inside)
        rows.append(_row(name, error, true, np.array([trial.std[name] for trial in good]), inside))
    return Recovery(tuple(rows), float(np.mean(held)), failures)


def _row(name: str, error: FloatArray, true: FloatArray, stated: FloatArray, inside: BoolArray) -> ParameterRecovery:
    scatter = float(np.std(error, ddof=1))
    return ParameterRecovery(
        name=name,
        truth=float(true.mean()),
        mean_error=float(error.mean()),
        standard_error=scatter / float(np.sqrt(error.size)),
        scatter=scatter,
        stated=float(np.sqrt(np.mean(stated**2))),
        coverage=float(np.mean(inside)),
        repetitions=int(error.size),
    )


def recovery_table(found: Recovery) -> str:
    """The comparison as aligned text.

    Examples
    --------
    >>> row = ParameterRecovery("drag", 3.0, 0.01, 0.02, 0.1, 0.11, 0.95, 20)
    >>> print(recovery_table(Recovery((row,), 0.95, ())))
    parameter           truth  mean error  of its s.e.    scatter     stated  covered
    drag                    3        0.01         +0.5        0.1       0.11     95 %
    all                                                                          95 %
    """
    lines = [
        f"{'parameter':14}{'truth':>11}{'mean error':>12}{'of its s.e.':>13}{'scatter':>11}{'stated':>11}{'covered':>9}"
    ]
    for row in found.parameters:
        numbers = f"{row.truth:>11.4g}{row.mean_error:>12.3g}{row.in_standard_errors:>+13.1f}"
        mark = "  biased" if row.biased else ""
        lines.append(f"{row.name:14}{numbers}{row.scatter:>11.3g}{row.stated:>11.3g}{100 * row.coverage:>7.0f} %{mark}")
    lines.append(f"{'all':14}{100 * found.coverage:>65.0f} %")
    return "\n".join(lines + [f"failed: {failure}" for failure in found.failures])
