"""Draws from the posterior of an estimate by an ensemble of walkers, which are filtered all at once.

The density is the likelihood times the priors inside the bounds, flat in the coordinates that searches move: in the
logarithm where a parameter is searched on a logarithmic scale. The sampler is emcee's affine-invariant ensemble, which
minds no correlation of parameters and moves half of its walkers in one batch. References: Goodman and Weare (2010),
Ensemble samplers with affine invariance, CAMCoS 5(1); Foreman-Mackey et al. (2013), emcee: The MCMC Hammer, PASP 125.
"""

from __future__ import annotations

import enum
import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bondgraph.coherent import Displayed
from bondgraph.errors import EstimationError, OptionError, require_kind
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.prediction import drawn_points
from bondgraph.estimate.quantities import quantity_of, unit_of
from bondgraph.estimate.result import Estimate
from bondgraph.frames import frame
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, number, text_table

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: A chain is long enough when it is so many integrated autocorrelation times long (emcee's documentation).
_LENGTHS = 50.0
#: Walkers for each coordinate; the method needs more than two.
_WALKERS = 4


class PosteriorOutcome(enum.Enum):
    """How far draws can be trusted; the value is the message."""

    LONG_ENOUGH = "the chains are longer than fifty autocorrelation times"
    TOO_SHORT = "the chains are shorter than fifty autocorrelation times - take more steps"


@dataclass(frozen=True, repr=False)
class Posterior(Tabulated, Kept):
    """Draws of the free parameters of an estimate.

    Parameters
    ----------
    names, units, quantities
        Free parameters and how they are shown.
    draws
        Values in the units of the model, shape (walkers, draws, n).
    log_density
        Logarithm of the density in the coordinates, shape (walkers, draws).
    autocorrelation
        Integrated autocorrelation time of each parameter in draws, shape (n,).
    acceptance
        Share of the moves that were accepted.
    evaluations
        Evaluations of the likelihood.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    quantities: tuple[Displayed, ...]
    draws: FloatArray
    log_density: FloatArray
    autocorrelation: FloatArray
    acceptance: float
    evaluations: int

    def __repr__(self) -> str:
        walkers, draws, _ = self.draws.shape
        return f"<Posterior of {', '.join(self.names)}: {walkers} walkers, {draws} draws; {self.outcome.value}>"

    @property
    def outcome(self) -> PosteriorOutcome:
        """Whether the chains are long enough."""
        enough = self.draws.shape[1] >= _LENGTHS * float(self.autocorrelation.max())
        return PosteriorOutcome.LONG_ENOUGH if enough else PosteriorOutcome.TOO_SHORT

    @property
    def effective(self) -> FloatArray:
        """Number of independent draws that tell as much, shape (n,)."""
        size: FloatArray = self.draws.shape[0] * self.draws.shape[1] / self.autocorrelation
        return size

    def summary(self) -> str:
        """The table, and whether the chains are long enough."""
        return f"{text_table(*self.table())}\n{self.outcome.value}"

    def table(self) -> Table:
        """Mean, standard deviation and 95 % interval of every parameter in declared units."""
        rows = []
        for k, name in enumerate(self.names):
            values = np.asarray(self.quantities[k].shown(self.draws[:, :, k].ravel()))
            ends = np.quantile(values, [0.025, 0.975])
            numbers = (values.mean(), values.std(ddof=1), *ends, self.effective[k])
            rows.append([name, self.units[k], *(number(float(one)) for one in numbers)])
        return ("parameter", "unit", "mean", "std", "2.5 %", "97.5 %", "independent"), rows

    def to_dataframe(self) -> pandas.DataFrame:
        """All draws in declared units, a column for each parameter.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        columns = zip(self.names, self.quantities, range(len(self.names)), strict=True)
        return frame({name: np.asarray(info.shown(self.draws[:, :, k].ravel())) for name, info, k in columns})

    def to_inference_data(self) -> Any:
        """The draws as ArviZ holds them, in the units of the model: groups ``posterior`` and ``sample_stats``.

        ArviZ 1 keeps what was its InferenceData in a tree of xarray.

        Raises
        ------
        OptionError
            If ArviZ is not installed.
        """
        library = _library("arviz_base")
        values = {name: self.draws[:, :, k] for k, name in enumerate(self.names)}
        return library.from_dict({"posterior": values, "sample_stats": {"lp": self.log_density}})

    def plot(self, name: str = "", ax: Axes | None = None) -> Axes:
        """Histogram of one parameter, the first if none is named.

        Raises
        ------
        OptionError
            If it was not drawn.
        """
        if name and name not in self.names:
            raise OptionError(f"posterior: no parameter {name!r} - there are {', '.join(self.names)}", where=(name,))
        k, axes = self.names.index(name) if name else 0, own_axes(ax)
        axes.hist(np.asarray(self.quantities[k].shown(self.draws[:, :, k].ravel())), bins=60, density=True, alpha=0.6)
        axes.set_xlabel(f"{self.names[k]} [{self.units[k]}]")
        axes.set_ylabel("density")
        return axes


def sample_posterior(
    estimate: Estimate, draws: int = 1000, *, burn: int = 200, walkers: int = 0, seed: int = 0
) -> Posterior:
    """Draws from the posterior of the free parameters of an estimate.

    Parameters
    ----------
    estimate
        Where walkers start, scattered by its covariance.
    draws
        Kept steps of every walker.
    burn
        Steps before these.
    walkers
        Walkers; 0: four for each parameter. An even number, at least twice as many as parameters.
    seed
        The same seed gives the same draws.

    Raises
    ------
    OptionError
        If emcee is not installed, or a number does not fit.
    EstimationError
        If the likelihood is not finite where walkers start.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(60) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 60)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> fit = bg.estimate(swing, log, ["length"], bg.Settings(method="gradient", starts=1))
    >>> sample_posterior(fit, 20, burn=10).draws.shape
    (4, 20, 1)
    """
    require_kind("posterior", estimate, Estimate, "finished estimate")
    problem, size = estimate.problem, estimate.point.size
    count = walkers or max(_WALKERS * size, 4)
    if draws < 1 or burn < 0 or count < 2 * size or count % 2:
        raise OptionError(
            f"posterior: {draws} draws after {burn} with {count} walkers of {size} parameters"
            " - give at least one draw and an even number of walkers, twice as many as parameters or more",
            where=("draws", "burn", "walkers"),
        )
    sampler_type = _library("emcee").EnsembleSampler
    lower, upper = problem.lower, problem.upper

    def log_density(points: FloatArray) -> FloatArray:
        inside = np.all((points >= lower) & (points <= upper), axis=1)
        density = np.full(points.shape[0], -np.inf)
        if inside.any():
            density[inside] = -problem.nll(np.ascontiguousarray(points[inside].T))
        return density

    start = drawn_points(estimate, count, seed).T
    if not np.isfinite(log_density(start)).all():
        raise EstimationError(
            f"{problem.name}: the likelihood is not finite at values that the estimate holds likely"
            " - use more substeps, or estimate longer",
            where=problem.names,
        )
    sampler = sampler_type(count, size, log_density, vectorize=True)
    sampler.random_state = np.random.RandomState(seed % 2**32).get_state()
    sampler.run_mcmc(start, burn + draws, progress=False)
    return _posterior(estimate, sampler, burn)


def _posterior(estimate: Estimate, sampler: Any, burn: int) -> Posterior:
    problem, coordinates = estimate.problem, sampler.get_chain(discard=burn)  # (draws, walkers, n)
    values = problem.values(np.moveaxis(coordinates, 2, 0))
    correlated = sampler.get_autocorr_time(discard=burn, quiet=True, tol=0)
    return Posterior(
        names=problem.names,
        units=tuple(unit_of(problem, one) for one in problem.free),
        quantities=tuple(quantity_of(problem, one) for one in problem.free),
        draws=np.ascontiguousarray(np.transpose(values, (2, 1, 0))),
        log_density=np.ascontiguousarray(sampler.get_log_prob(discard=burn).T),
        autocorrelation=np.maximum(np.nan_to_num(correlated, nan=np.inf, posinf=np.inf), 1.0),
        acceptance=float(np.mean(sampler.acceptance_fraction)),
        evaluations=int(sampler.iteration * sampler.nwalkers + sampler.nwalkers),
    )


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise OptionError(
            f"posterior: {name} is not installed - run: pip install 'bondloop[posterior]'", where=(name,)
        ) from None
