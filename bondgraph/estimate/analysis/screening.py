"""Global sensitivity over the whole bounds: Morris' elementary effects and Sobol's shares of variance, by SALib.

What is local at one point (:mod:`bondgraph.estimate.analysis.ranking`) may be otherwise elsewhere in the bounds.
Morris' means of absolute elementary effects tell for few evaluations what does not matter at all; Sobol's indices tell
which share of the variance of a response a parameter brings alone (first order) and with all others (total).
References: Morris (1991), Factorial sampling plans for preliminary computational experiments, Technometrics 33(2);
Saltelli et al. (2010), Variance based sensitivity analysis of model output, Computer Physics Communications 181(2);
Herman and Usher (2017), SALib: An open-source Python library for sensitivity analysis, JOSS 2(9).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bondgraph.compile.lanes.text import LANES
from bondgraph.errors import EstimationError, OptionError, suggest
from bondgraph.estimate.analysis.screening_methods import LITTLE, SCREENING_METHODS, Indices, Method, ScreeningMethod
from bondgraph.estimate.free_simulation import simulated_members
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.execute.executors import open_executor
from bondgraph.execute.shared import Shared
from bondgraph.execute.tasks import in_order
from bondgraph.frames import frame
from bondgraph.shown import Tabulated, own_axes
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, count, few, number, text_table

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: A response at points (n, members): one number for each member, not finite where it fails.
Response = Callable[[FloatArray], FloatArray]
Reduction = Literal["rms", "mean", "largest", "last"]
_REDUCTIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "rms": lambda y: np.sqrt(np.mean(y**2, axis=0)),
    "mean": lambda y: np.mean(y, axis=0),
    "largest": lambda y: np.max(np.abs(y), axis=0),
    "last": lambda y: y[-1],
}
#: Share of failed members above which nothing is said. A convention.
_MOST_FAILED = 0.2
#: What to do where intervals are too wide: a likelihood over wide bounds is ruled by their worst corners.
_MORE = "take more samples, narrower bounds or another response"
#: Members of a task: four blocks of the compiled filter.
_BLOCK = 4 * LANES
#: A response beyond this has run away, and its square is no number any more.
_RUNAWAY = 1e100


@dataclass(frozen=True, repr=False)
class GlobalSensitivity(Tabulated, Kept):
    """Indices of a response over a box.

    Parameters
    ----------
    method
        ``"morris"`` or ``"sobol"``.
    names
        Parameters.
    indices
        By column: ``mu_star``, ``mu`` and ``sigma`` of elementary effects over the whole width of a bound, or
        ``first`` and ``total`` shares of variance; each (n,).
    confidence
        Half width of the 95 % interval of ``mu_star``, or of ``first`` and ``total``, each (n,).
    evaluations, failed
        Members evaluated, and of these how many failed and count as the largest response.
    response
        What was asked, in words.
    """

    method: Method
    names: tuple[str, ...]
    indices: Mapping[str, FloatArray]
    confidence: Mapping[str, FloatArray]
    evaluations: int
    failed: int
    response: str

    def __repr__(self) -> str:
        return f"<GlobalSensitivity of {self.response}: {self.method}, {count(self.evaluations, 'evaluation')}>"

    @property
    def _screening(self) -> ScreeningMethod:
        return SCREENING_METHODS[self.method]

    @property
    def _found(self) -> Indices:
        return Indices(self.indices, self.confidence)

    @property
    def order(self) -> tuple[int, ...]:
        """Positions of the parameters, most important first."""
        return tuple(int(k) for k in np.argsort(-self.indices[self._screening.key], kind="stable"))

    def table(self) -> Table:
        """Header, and a row for each parameter, most important first."""
        columns = self._screening.columns
        header = ["parameter", *(name for column in columns for name in self._headed(column))]
        rows = [
            [self.names[k], *(number(float(values[k])) for column in columns for values in self._values(column))]
            for k in self.order
        ]
        return header, rows

    @property
    def title(self) -> str:
        """Response, method, evaluations and failures in a line."""
        note = f"; {self.failed} failed and count as the largest response" if self.failed else ""
        return f"{self.response}, {self.method}: {count(self.evaluations, 'evaluation')}{note}"

    def summary(self) -> str:
        """A line for each parameter, most important first, and in words what they say."""
        return "\n".join([self.title, text_table(*self.table()), *self.advice()])

    def advice(self) -> tuple[str, ...]:
        """Sentences: what the response follows, what hardly matters to it, and what these samples do not tell.

        Examples
        --------
        >>> shares = {"first": np.array([0.9, 0.0, 0.1]), "total": np.array([0.9, 0.01, 0.4])}
        >>> widths = {"first": np.array([0.05, 0.01, 0.2]), "total": np.array([0.05, 0.02, 0.5])}
        >>> for sentence in GlobalSensitivity("sobol", ("m", "eta", "k"), shares, widths, 320, 0, "speed").advice():
        ...     print(sentence)
        follows m
        hardly follows eta: less than 5 % of the variance
        64 samples do not tell whether k matters: take more samples, narrower bounds or another response
        """
        own, whole = self._screening, self._screening.whole(self._found)
        least = (self.indices[own.key] - self.confidence[own.key]) / whole
        most = (self.indices[own.key] + self.confidence[own.key]) / whole
        matters, little = least > LITTLE, most < LITTLE
        together = own.together(self._found)
        samples = f"{own.size(self.evaluations, len(self.names))} {own.sample}"
        said = (
            (matters, "follows {}"),
            (together & matters, "not by each alone, but together: {}"),
            (little, f"hardly follows {{}}: less than {LITTLE:.0%} of the {own.of}".replace("%", " %")),
            (~matters & ~little, f"{samples} do not tell whether {{}} matters: {_MORE}"),
        )
        return tuple(
            text.format(few([self.names[k] for k in self.order if rows[k]])) for rows, text in said if any(rows)
        )

    def _headed(self, column: str) -> list[str]:
        return [column, "+-"] if column in self.confidence else [column]

    def _values(self, column: str) -> list[FloatArray]:
        return [group[column] for group in (self.indices, self.confidence) if column in group]

    def to_dataframe(self) -> pandas.DataFrame:
        """Indices and half widths of their intervals, a row for each parameter.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        widths = {f"{name}_confidence": values for name, values in self.confidence.items()}
        return frame({**self.indices, **widths}, self.names, "parameter")

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON holds it."""
        rows = {
            name: {
                **{column: float(values[k]) for column, values in self.indices.items()},
                **{f"{column}_confidence": float(values[k]) for column, values in self.confidence.items()},
            }
            for k, name in enumerate(self.names)
        }
        head = {"method": self.method, "response": self.response}
        return {**head, "evaluations": self.evaluations, "failed": self.failed, "parameters": rows}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Bars of Sobol's indices with their intervals, or Morris' plane of mean and spread."""
        axes = own_axes(ax, 6.0, 1.0 + 0.32 * len(self.names))
        self._screening.draw(axes, self.names, self.order, self._found)
        axes.set_title(self.response)
        return axes


def global_sensitivity(
    response: Response,
    bounds: Mapping[str, tuple[float, float]],
    method: Method = "sobol",
    *,
    samples: int = 0,
    seed: int = 0,
    meaning: str = "response",
    executor: str | Executor | None = "serial",
) -> GlobalSensitivity:
    """Sensitivity of a response to parameters over their whole bounds.

    Parameters
    ----------
    response
        Gives one number for each member of points (n, members), rows in the order of the bounds.
    bounds
        Lower and upper bound of each parameter.
    method
        ``"sobol"`` at samples*(n + 2) evaluations, or ``"morris"`` at samples*(n + 1).
    samples
        Base samples (a power of two for Sobol) or trajectories; 0: 1024 or 40.
    seed
        The same seed gives the same numbers.
    meaning
        The response in words.
    executor
        Who evaluates members, see :func:`bondgraph.execute.executors.open_executor`; it changes no number.

    Raises
    ------
    OptionError
        If the method is not known, a number does not fit it, or SALib is not installed.
    EstimationError
        If more than a fifth of the members fail, or the response does not move.

    Examples
    --------
    >>> found = global_sensitivity(lambda x: 2.0 * x[0] + x[1], {"a": (0.0, 1.0), "b": (0.0, 1.0)}, samples=256)
    >>> found.indices["first"].round(2).tolist()
    [0.8, 0.2]
    """
    if method not in SCREENING_METHODS:
        raise OptionError(
            f"global sensitivity: method {method!r} is not known{suggest(method, SCREENING_METHODS)}"
            " - choose morris or sobol",
            where=("method", method),
        )
    screening = SCREENING_METHODS[method]
    size = samples or screening.usual
    if not screening.accepts(size):
        raise OptionError(f"global sensitivity: {size} samples - {method} needs {screening.need}", where=("samples",))
    space = {"num_vars": len(bounds), "names": list(bounds), "bounds": [list(pair) for pair in bounds.values()]}
    points = screening.sampled(space, size, seed)
    with open_executor(executor) as workers:
        values, failed = _responses(response, points, meaning, workers)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pandas and numpy inside the library
        found = screening.analysed(space, points, values, seed)
    return GlobalSensitivity(method, tuple(bounds), found.values, found.widths, values.size, failed, meaning)


def _responses(
    response: Response, points: FloatArray, meaning: str, executor: Executor | None
) -> tuple[FloatArray, int]:
    """Responses (members,), failed ones as the largest of the others, and how many failed."""
    if executor is None:
        values = np.array(response(np.ascontiguousarray(points.T)), dtype=np.float64)
    else:
        shared = Shared.of(response)
        blocks = [points[first : first + _BLOCK].T for first in range(0, points.shape[0], _BLOCK)]
        values = np.concatenate(in_order(executor, _some_responses, [(shared, some) for some in blocks]))
    finite = np.isfinite(values) & (np.abs(values) < _RUNAWAY)
    failed = int((~finite).sum())
    if failed > _MOST_FAILED * values.size:
        raise EstimationError(
            f"global sensitivity of {meaning}: {failed} of {values.size} members fail inside the bounds"
            " - narrow the bounds, or use more substeps",
            where=(meaning,),
        )
    values[~finite] = values[finite].max()
    if np.ptp(values) == 0.0:
        raise EstimationError(
            f"global sensitivity of {meaning}: it is {values[0]:.6g} everywhere inside the bounds, so nothing moves it"
            " - free other parameters, or ask another response",
            where=(meaning,),
        )
    return values, failed


def _some_responses(shared: Shared[Response], points: FloatArray) -> FloatArray:
    return np.array(shared.open()(np.ascontiguousarray(points)), dtype=np.float64)


def likelihood_response(problem: Problem) -> Response:
    """The negative log-likelihood of the logs of a problem, as a response over its coordinates."""
    return problem.nll


def output_response(problem: EstimationProblem, output: str, reduction: Reduction = "rms") -> Response:
    """One number of a simulated output, as a response over the coordinates of a problem.

    Parameters
    ----------
    problem
        Its model is simulated along its logs, which follow each other.
    output
        Name of the output.
    reduction
        ``"rms"``, ``"mean"``, ``"largest"`` (by amount) or ``"last"``, in coherent SI.

    Raises
    ------
    OptionError
        If there is no such output or reduction.
    """
    known = problem.filter_model.model.names("output")
    if output not in known:
        raise OptionError(
            f"sensitivity of {output!r}: {problem.filter_model.model.name} has no such output{suggest(output, known)}"
            f" - it has {', '.join(known)}",
            where=(output,),
        )
    if reduction not in _REDUCTIONS:
        raise OptionError(
            f"sensitivity of {output}: {reduction!r} is not known{suggest(reduction, _REDUCTIONS)}"
            f" - choose {', '.join(_REDUCTIONS)}",
            where=(reduction,),
        )
    return _OutputResponse(problem, known.index(output), reduction)


@dataclass(frozen=True)
class _OutputResponse:
    """One number of the output in a row, see :func:`output_response`; workers can be given it."""

    problem: EstimationProblem
    row: int
    reduction: Reduction

    def __call__(self, points: FloatArray) -> FloatArray:
        every = np.concatenate([y[self.row] for y in simulated_members(self.problem, points)])
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(every).all(axis=0), _REDUCTIONS[self.reduction](every), np.inf)


def problem_bounds(problem: Problem) -> dict[str, tuple[float, float]]:
    """Bounds of the coordinates of a problem by name."""
    ends = zip(problem.lower, problem.upper, strict=True)
    return {name: (float(a), float(b)) for name, (a, b) in zip(problem.names, ends, strict=True)}
