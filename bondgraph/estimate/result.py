"""The result of an estimation: values with their uncertainty in the units of the model, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bondgraph.errors import EstimationError, suggest
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, Certification
from bondgraph.estimate.continuation import Stage
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.estimated import estimated_filter, next_prior, normal_interval
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.inputs_otherwise import InputsOtherwise
from bondgraph.estimate.joint import Problem, Rows
from bondgraph.estimate.likelihoods import Batch
from bondgraph.estimate.objective import FloatArray, SearchOutcome, TraceRow
from bondgraph.estimate.priors import MultivariateNormal
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.profile import ProfileInterval, profile_interval
from bondgraph.estimate.quantities import quantity_of, unit_of
from bondgraph.estimate.uncertainty import UncertaintyOutcome
from bondgraph.filter.consistency import misfits
from bondgraph.filter.figure import Panels
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.misfit import Misfit
from bondgraph.filter.runs import run
from bondgraph.frames import frame
from bondgraph.shown import Tabulated
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, count, few, known, number, text_table

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Optimum:
    """One end of a gradient search: values by name, its negative log-likelihood, and how many starts ended there."""

    values: Mapping[str, float]
    nll: float
    starts: int


@dataclass(frozen=True, repr=False)
class Estimate(Panels, Tabulated, Kept):
    """An estimate of the free parameters of a problem.

    Parameters
    ----------
    problem
        What was estimated from what.
    point
        Coordinates of the optimum, shape (n,).
    nll
        Negative log-likelihood plus priors there.
    covariance
        Of the values, shape (n, n), in products of their units; NaN for what is not identifiable.
    correlation
        Shape (n, n).
    at_bound
        Names that rest on a bound: their optimum may lie outside.
    not_identifiable
        Groups of names that the data cannot tell apart, or single ones about which they say nothing.
    optima
        Distinct ends of the gradient searches, best first.
    evaluations, seconds, trace, outcome
        Of the search; evaluations count members, uncertainty included.
    uncertainty_outcome
        Where the covariance comes from.
    roughness
        How far off the optimum is, in standard deviations, by values around it instead of its derivatives: large where
        the likelihood is not smooth. NaN where it was not measured.
    certification
        How the model was integrated, and whether finer steps would move the estimate.
    way
        Searches with more process noise that came before, see :mod:`bondgraph.estimate.continuation`.
    abandoned
        Of the evaluations, those that were ended when it was certain that they were no improvement.
    inputs_otherwise
        Inputs that are likelier another way between samples than declared; None where none is, or none was tried.
    """

    problem: Problem
    point: FloatArray
    nll: float
    covariance: FloatArray
    correlation: FloatArray
    at_bound: tuple[str, ...]
    not_identifiable: tuple[tuple[str, ...], ...]
    optima: tuple[Optimum, ...]
    evaluations: int
    seconds: float
    trace: tuple[TraceRow, ...]
    outcome: SearchOutcome
    uncertainty_outcome: UncertaintyOutcome
    certification: Certification
    roughness: float = math.nan
    way: tuple[Stage, ...] = ()
    abandoned: int = 0
    inputs_otherwise: InputsOtherwise | None = None

    @cached_property
    def end(self) -> str:
        """How the search ended, in words; of one that never began, what ended the filter at its start."""
        failed = next((one for one in self.runs if one.outcome is not Outcome.OK), None)
        if self.outcome is not SearchOutcome.NO_FINITE_POINT or failed is None:
            return self.outcome.value
        at = few([f"{one.name} = {number(self._shown(one)[0])}" for one in self.problem.free])
        return f"{self.outcome.value.partition(' - ')[0]}; {failed.log_name}, at {at}: {failed.end}"

    def __repr__(self) -> str:
        end = f"NLL {self.nll:.6g}, {count(self.evaluations, 'evaluation')}; {self.outcome.value.partition(' - ')[0]}"
        values = [f"{one.name} = {number(self._shown(one)[0])}" for one in self.problem.free]
        return f"<Estimate {self.problem.name}: {few(values)}; {end}>"

    def summary(self) -> str:
        """How the search ended, the table of the estimates, and what is likelier than the inputs as declared."""
        data = f"{few([log.name for log in self.problem.logs])}: NLL {self.nll:.6g}"
        lines = [self.end, f"{data}, {self.certification.verdict} steps", text_table(*self.table())]
        return "\n".join([*lines, *([self.inputs_otherwise.sentence] if self.inputs_otherwise else [])])

    def table(self) -> Table:
        """The estimates in declared units with their uncertainty.

        The last column says what rests on a bound and what these data do not tell.
        """
        unknown = {name for group in self.not_identifiable for name in group}
        rows = [
            [one.name, unit_of(self.problem, one), *map(known, self._shown(one)), self._remark(one.name, unknown)]
            for one in self.problem.free
        ]
        return ("parameter", "unit", "value", "std", "2.5 %", "97.5 %", ""), rows

    def to_dataframe(self) -> pandas.DataFrame:
        """The estimates in declared units, a row for each free parameter.

        Columns ``value``, ``std``, ``lower95``, ``upper95``, ``lower_bound``, ``upper_bound``, ``unit``, ``at_bound``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        rows = [
            (*self._shown(one), *self._bounds(one), unit_of(self.problem, one), one.name in self.at_bound)
            for one in self.problem.free
        ]
        names = ("value", "std", "lower95", "upper95", "lower_bound", "upper_bound", "unit", "at_bound")
        return frame(dict(zip(names, zip(*rows, strict=True), strict=True)), self.problem.names, "parameter")

    def _shown(self, parameter: FreeParameter) -> tuple[float, float, float, float]:
        """Value, standard deviation and ends of the 95 % interval as they are shown."""
        show, name = quantity_of(self.problem, parameter).shown, parameter.name
        lower, upper = self.ci95[name]
        return show(self.values[name]), show(self.std[name]), show(lower), show(upper)

    def _bounds(self, parameter: FreeParameter) -> tuple[float, float]:
        show = quantity_of(self.problem, parameter).shown
        return show(parameter.lower), show(parameter.upper)

    def _remark(self, name: str, unknown: Container[str]) -> str:
        return "at a bound" if name in self.at_bound else "not identifiable" if name in unknown else ""

    @cached_property
    def values(self) -> Mapping[str, float]:
        """Values by name, in the units of the model."""
        values = self.problem.values(self.point)
        return {name: float(value) for name, value in zip(self.problem.names, values, strict=True)}

    @cached_property
    def std(self) -> Mapping[str, float]:
        """Standard deviations by name; NaN where not identifiable."""
        with np.errstate(invalid="ignore"):
            deviations = np.sqrt(np.diag(self.covariance))
        return {name: float(value) for name, value in zip(self.problem.names, deviations, strict=True)}

    @property
    def coordinate_covariance(self) -> FloatArray:
        """Covariance of the coordinates that were searched, shape (n, n); NaN for what is not identifiable."""
        slopes = np.array([one.slope(self.values[one.name]) for one in self.problem.free])
        covariance: FloatArray = self.covariance / np.outer(slopes, slopes)
        return covariance

    @property
    def is_smooth(self) -> bool:
        """Whether values around the optimum agree with its derivatives as far as an estimate could notice."""
        return not self.roughness > NEGLIGIBLE_SHIFT

    @cached_property
    def ci95(self) -> Mapping[str, tuple[float, float]]:
        """95 % intervals by name, within the bounds; the bounds themselves where not identifiable."""
        return {one.name: normal_interval(one, self.values[one.name], self.std[one.name]) for one in self.problem.free}

    @cached_property
    def parts(self) -> tuple[Estimate, ...]:
        """Estimates of the single problems of a joint one, with their own free parameters; else this one."""
        if isinstance(self.problem, EstimationProblem):
            return (self,)
        pairs = zip(self.problem.parts, self.problem.rows, strict=True)
        return tuple(self._part(problem, rows) for problem, rows in pairs)

    def _part(self, problem: EstimationProblem, rows: Rows) -> Estimate:
        square, own = np.ix_(rows, rows), set(problem.names)
        return replace(
            self,
            problem=problem,
            point=self.point[rows],
            nll=float(problem.nll(self.point[rows, np.newaxis])[0]),
            covariance=self.covariance[square],
            correlation=self.correlation[square],
            at_bound=tuple(name for name in self.at_bound if name in own),
            not_identifiable=tuple(group for group in self.not_identifiable if own & set(group)),
            optima=(),
            trace=(),
        )

    @property
    def single(self) -> EstimationProblem:
        """The problem, if it has one filter model.

        Raises
        ------
        EstimationError
            If it is a joint one.
        """
        if isinstance(self.problem, EstimationProblem):
            return self.problem
        raise EstimationError(
            f"estimate of {self.problem.name}: several filter models have no numbers in common - take one of its parts",
            where=("parts",),
        )

    def as_prior(self, names: Sequence[str] = ()) -> MultivariateNormal:
        """What the logs said, as a prior for an estimation from other logs: a stage before the next.

        It is the likelihood to second order around the optimum, in the coordinates that were searched: the values, or
        their logarithms. Logs of both stages in one joint problem give the same estimate, as far as that holds.

        Parameters
        ----------
        names
            Parameters that it is about; empty: all parameters of the model that the logs told of, off their bounds.

        Raises
        ------
        EstimationError
            If nothing was told of a parameter, or it was searched by its logit.
        """
        return next_prior(self.problem, self.point, self.coordinate_covariance, self.at_bound, names)

    @cached_property
    def batch(self) -> Batch:
        """All numbers of the estimated model and filter, as a batch of one member."""
        return self.single.batch(self.point[:, np.newaxis])

    @property
    def theta(self) -> FloatArray:
        """Parameters of the model, shape (n_theta,); what a log knows is not in them."""
        return self.batch.theta[:, 0]

    @property
    def x0(self) -> tuple[FloatArray, ...]:
        """Initial state of each log, shape (n_x,)."""
        return tuple(start[:, 0] for start in self.batch.x0)

    @property
    def filter_model(self) -> FilterModel:
        """The filter model with the estimated noise levels in place of the declared ones."""
        return estimated_filter(self.single, self.point)

    @cached_property
    def runs(self) -> tuple[FilterRun, ...]:
        """The filter's record of each log at the estimate."""
        if not isinstance(self.problem, EstimationProblem):
            return tuple(one for part in self.parts for one in part.runs)
        logs = zip(self.problem.logs, self.x0, strict=True)
        return tuple(run(self.filter_model, log, self.theta, x0=x0) for log, x0 in logs)

    @cached_property
    def misfits(self) -> tuple[Misfit, ...]:
        """Channels that the estimated model does not explain, by the noises at the start of its search."""
        parts = [(part.runs, part.single.filter_model.measurement_noise) for part in self.parts]
        return tuple(one for runs, noise in parts for one in misfits(runs, noise))

    def profile(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Interval of one value by its profile likelihood; takes some tens of evaluations per free parameter.

        Curves and pictures: :func:`bondgraph.estimate.likelihood_profile.profile_likelihood`.

        Parameters
        ----------
        name
            A free parameter that is identifiable.
        level
            Coverage.

        Raises
        ------
        EstimationError
            If it is not free, or the data say nothing about it.
        """
        interval = self.profile_interval(name, level)
        lower, upper = self.problem.free[self.problem.names.index(name)].values(
            np.array([interval.lower, interval.upper])
        )
        return float(lower), float(upper)

    def profile_interval(self, name: str, level: float = 0.95, executor: Executor | None = None) -> ProfileInterval:
        """Interval of one coordinate by its profile likelihood; arguments and errors as for :meth:`profile`."""
        if not math.isfinite(self.std.get(name, math.nan)):
            known = [other for other, std in self.std.items() if math.isfinite(std)]
            raise EstimationError(
                f"profile: {name!r} is not an identified parameter of this estimate{suggest(name, known)}"
                f" - there are {', '.join(known) or 'none'}",
                where=(name,),
            )
        index = self.problem.names.index(name)
        parameter = self.problem.free[index]
        std = self.std[name] / parameter.slope(self.values[name])
        covariance = np.nan_to_num(self.coordinate_covariance)
        direction = covariance[:, index] / covariance[index, index]
        return profile_interval(
            self.problem, self.point, index, std, level, jacobian=derivatives, direction=direction, executor=executor
        )

    def _parameter_dict(self, parameter: FreeParameter) -> dict[str, Any]:
        info = quantity_of(self.problem, parameter)
        return {
            "value": info.shown(self.values[parameter.name]),
            "unit": unit_of(self.problem, parameter),
            "std": _number(info.shown(self.std[parameter.name])),
            "ci95": [info.shown(end) for end in self.ci95[parameter.name]],
            "bounds": list(self._bounds(parameter)),
            "at_bound": parameter.name in self.at_bound,
        }

    def to_dict(self, innovations: Mapping[str, Mapping[str, Any]] | None = None) -> dict[str, Any]:
        """The estimate as ``result.json`` holds it, in declared units; numbers that do not exist are null.

        Parameters
        ----------
        innovations
            Per output ``rmse``, ``nis_mean``, ``nis_band`` and ``whiteness_p`` of the filter at the estimate; without
            them the filter is not run, and no misfits are listed.
        """
        names = self.problem.names
        shown = {parameter.name: quantity_of(self.problem, parameter).shown for parameter in self.problem.free}
        parameters = {parameter.name: self._parameter_dict(parameter) for parameter in self.problem.free}
        return {
            "parameters": parameters,
            "nll": _number(self.nll),
            "evaluations": self.evaluations,
            "abandoned": self.abandoned,
            "seconds": round(self.seconds, 3),
            "innovations": {name: dict(values) for name, values in (innovations or {}).items()},
            "misfits": [] if innovations is None else [misfit.to_dict() for misfit in self.misfits],
            "correlation": {
                name: {other: _number(float(self.correlation[i, j])) for j, other in enumerate(names)}
                for i, name in enumerate(names)
            },
            "not_identifiable": [list(group) for group in self.not_identifiable],
            "outcome": self.end,
            "converged": self.outcome.succeeded,
            "uncertainty": self.uncertainty_outcome.value,
            "roughness": _number(self.roughness),
            "smooth": self.is_smooth,
            "optima": [{"values": _shown(o.values, shown), "nll": o.nll, "starts": o.starts} for o in self.optima],
            "discretisation": self.certification.to_dict(),
            "continuation": [
                {
                    "scale": s.scale,
                    "nll": _number(s.nll),
                    "evaluations": s.evaluations,
                    "values": _shown(s.values, shown),
                }
                for s in self.way
            ],
            "inputs_otherwise": None if self.inputs_otherwise is None else self.inputs_otherwise.to_dict(),
            "logs": [log.name for log in self.problem.logs],
        }


def _shown(values: Mapping[str, float], shown: Mapping[str, Callable[[float], float]]) -> dict[str, float]:
    return {name: shown[name](value) for name, value in values.items()}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
