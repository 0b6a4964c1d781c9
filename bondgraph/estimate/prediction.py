"""Prediction bands of simulations from the covariance of an estimate.

The delta method: var y = (dy/dp) cov (dy/dp)', with exact sensitivities of the simulation. Where the covariance is wide
or the model bends, draws of the parameters show the same band without that straight line. Reference: Seber and Wild
(1989), Nonlinear Regression, section 5.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.data.given import GivenLog, all_matched
from bondgraph.errors import EstimationError, OptionError, require_kind, suggest
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.free_simulation import simulated_logs, simulated_members, simulation_problem
from bondgraph.estimate.objective import FloatArray, fitted_expansion
from bondgraph.estimate.result import Estimate
from bondgraph.frames import frame
from bondgraph.shown import own_axes
from bondgraph.simulate.quantities import OutputInfo

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class PredictionBand:
    """Simulated outputs along one log with the standard deviation that the parameters leave.

    Parameters
    ----------
    name
        The log.
    time
        Shape (n,), s.
    outputs
        The outputs, in the order of the model.
    y
        Simulation at the estimate, shape (n_y, n), in the unit of the model.
    std
        Standard deviation by the parameters, shape (n_y, n).
    noise
        Standard deviation of the sensors, shape (n_y,), NaN where an output has none. Process noise is not in the band:
        it is what the model does by itself.
    """

    name: str
    time: FloatArray
    outputs: tuple[OutputInfo, ...]
    y: FloatArray
    std: FloatArray
    noise: FloatArray

    def __repr__(self) -> str:
        return f"<PredictionBand {self.name}: {len(self.outputs)} outputs, {self.time.size} times>"

    def interval(self, level: float = 0.95, measured: bool = False) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends, each (n_y, n): of the course, or of what a sensor would measure.

        Raises
        ------
        OptionError
            If the level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise OptionError(f"prediction band: level {level:g} - give a share between 0 and 1", where=("level",))
        reach = NormalDist().inv_cdf(0.5 + 0.5 * level)
        extra = np.nan_to_num(self.noise)[:, np.newaxis] if measured else 0.0
        half = reach * np.hypot(self.std, extra)
        return self.y - half, self.y + half

    def _row(self, output: str) -> int:
        names = [info.name for info in self.outputs]
        if output and output not in names:
            raise OptionError(
                f"prediction band: no output {output!r}{suggest(output, names)} - there are {', '.join(names)}",
                where=(output,),
            )
        return names.index(output) if output else 0

    def to_dataframe(self) -> pandas.DataFrame:
        """Simulations and standard deviations in declared units, a row for each time.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        columns: dict[str, FloatArray] = {}
        for info, y, std in zip(self.outputs, self.y, self.std, strict=True):
            unit = info.display_unit or "1"
            columns[f"{info.name} [{unit}]"] = np.asarray(info.shown(y))
            columns[f"std({info.name}) [{unit}]"] = np.asarray(info.shown(y + std)) - np.asarray(info.shown(y))
        return frame(columns, self.time, "time [s]")

    def plot(self, output: str = "", ax: Axes | None = None, level: float = 0.95) -> Axes:
        """One output with its band, and the wider one in which a sensor would measure; the first if none is named.

        Raises
        ------
        OptionError
            If there is no such output.
        """
        row, axes = self._row(output), own_axes(ax, 7.0, 3.0)
        info = self.outputs[row]
        for measured, shade in ((True, 0.12), (False, 0.3)):
            lower, upper = (info.shown(end[row]) for end in self.interval(level, measured))
            label = f"{level:.0%} of measurements" if measured else f"{level:.0%} by the parameters"
            axes.fill_between(self.time, lower, upper, alpha=shade, linewidth=0.0, color="#1f5fa8", label=label)
        axes.plot(self.time, info.shown(self.y[row]), color="#1f5fa8", label="simulated")
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"{info.name} [{info.display_unit or 1}]")
        axes.legend(loc="best", fontsize="small")
        return axes


def predict(
    estimate: Estimate,
    logs: GivenLog | Sequence[GivenLog] = (),
    starts: Sequence[Mapping[str, float]] | None = None,
    *,
    draws: int = 0,
    seed: int = 0,
) -> tuple[PredictionBand, ...]:
    """Simulations at an estimate along logs, with bands from its covariance.

    Parameters
    ----------
    estimate
        A finished estimate.
    logs
        Times and inputs; none: those of the estimate.
    starts
        Initial states by name for each log; None: by the rule of the estimate.
    draws
        0: the delta method with exact sensitivities. Else so many simulations with parameters drawn from the normal
        law of the estimate, inside the bounds, whose mean and standard deviation are taken.
    seed
        Of the draws.

    Raises
    ------
    EstimationError
        If the model diverges, no parameter is free, or the estimate is of a joint problem: take one of its parts.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {}, {"deflection": 0.05}, {"angle": 0.01, "rate": 0.01}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> fit = bg.estimate(swing, log, ["length"], bg.Settings(method="gradient", starts=1))
    >>> (band,) = predict(fit)
    >>> bool((band.std > 0.0).all()), band.y.shape
    (True, (1, 100))
    """
    require_kind("predict", estimate, Estimate, "finished estimate")
    problem = estimate.single
    model = problem.filter_model.model
    chosen = tuple(all_matched(logs, model)) or problem.logs
    if draws:
        return _drawn(estimate, chosen, starts, draws, seed)
    noise = estimate.filter_model.noise_std
    found = []
    for run in simulated_logs(problem, estimate.point, chosen, starts):
        rows = [problem.names.index(name) for name in run.names]
        slopes = np.array([problem.free[row].slope(estimate.values[problem.names[row]]) for row in rows])
        covariance = known_covariance(estimate)[np.ix_(rows, rows)] * np.outer(slopes, slopes)
        variance = np.einsum("akm,mn,akn->ak", run.slopes, covariance, run.slopes)
        std = np.sqrt(np.maximum(variance, 0.0))
        found.append(PredictionBand(run.log.name, run.log.time, tuple(model.outputs), run.y, std, noise))
    return tuple(found)


def known_covariance(estimate: Estimate) -> FloatArray:
    """Covariance of the coordinates of an estimate, shape (n, n), finite where its data tell nothing, too.

    There the Fisher information is joined with that of a uniform law over the bounds before it is inverted, so that
    combinations that are told stay narrow.

    Raises
    ------
    EstimationError
        If the likelihood cannot be expanded at the estimate.
    """
    covariance = estimate.coordinate_covariance
    if np.isfinite(covariance).all():
        return covariance
    problem = estimate.problem
    information = fitted_expansion(problem, estimate.point, derivatives).information
    if not np.isfinite(information).all():
        raise EstimationError(
            f"{problem.name}: the estimate has no covariance, its likelihood cannot be expanded"
            " - estimate with more substeps or narrower bounds",
            where=problem.names,
        )
    width = problem.upper - problem.lower
    scaled = np.linalg.inv(information * np.outer(width, width) + 12.0 * np.eye(width.size))
    joined: FloatArray = scaled * np.outer(width, width)
    return joined


def drawn_points(estimate: Estimate, draws: int, seed: int) -> FloatArray:
    """Coordinates (n, draws) from the normal law of an estimate; those outside the bounds are drawn again.

    Raises
    ------
    EstimationError
        If hardly any draw falls inside the bounds.
    """
    problem, rng = estimate.problem, np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(known_covariance(estimate))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    kept = np.empty((estimate.point.size, 0))
    for _ in range(100):
        points = estimate.point[:, np.newaxis] + root @ rng.standard_normal((estimate.point.size, draws))
        inside = np.all((points >= problem.lower[:, np.newaxis]) & (points <= problem.upper[:, np.newaxis]), axis=0)
        kept = np.concatenate([kept, points[:, inside]], axis=1)
        if kept.shape[1] >= draws:
            return kept[:, :draws]
    raise EstimationError(
        f"{problem.name}: {kept.shape[1]} of {100 * draws} draws lie inside the bounds"
        " - the estimate rests on bounds; widen them",
        where=problem.names,
    )


def _drawn(
    estimate: Estimate, logs: Sequence[GivenLog], starts: Sequence[Mapping[str, float]] | None, draws: int, seed: int
) -> tuple[PredictionBand, ...]:
    problem, model = estimate.single, estimate.single.filter_model.model
    silent = simulation_problem(problem, all_matched(logs, model), starts)
    rows = [problem.names.index(name) for name in silent.names]
    points = drawn_points(estimate, draws, seed)[rows]
    found = []
    for log, y in zip(silent.logs, simulated_members(silent, points), strict=True):
        if not np.isfinite(y).all():
            raise EstimationError(
                f"{log.name}: the simulation diverges for some of {draws} draws of the parameters"
                " - use more substeps, or the delta method",
                where=(log.name,),
            )
        mean, std = y.mean(axis=-1), y.std(axis=-1, ddof=1)
        found.append(
            PredictionBand(log.name, log.time, tuple(model.outputs), mean, std, estimate.filter_model.noise_std)
        )
    return tuple(found)
