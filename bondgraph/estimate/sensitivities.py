"""Local sensitivities: what each measured output says about each parameter, before anything is estimated.

The Fisher information of a parameter is a sum over measured values, so it can be asked which output brings it, how well
each parameter would be known alone, and how much is lost to the others. Reference: Walter and Pronzato (1997),
Identification of Parametric Models from Experimental Data, section 6.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bondgraph.coherent import Displayed
from bondgraph.errors import EstimationError, require_kind
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.joint import JointProblem, Problem
from bondgraph.estimate.objective import Expand, Expansion, FloatArray, fitted_expansion
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.quantities import quantity_of, unit_of
from bondgraph.estimate.uncertainty import uncertainty
from bondgraph.frames import frame
from bondgraph.shown import Tabulated
from bondgraph.simulate.stored import Kept
from bondgraph.text import Table, few, number, text_table

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, repr=False)
class Sensitivity(Tabulated, Kept):
    """Information about the free parameters of a problem at one point.

    Parameters
    ----------
    names, outputs
        Free parameters and measured outputs; ``"prior"`` stands last where there are priors.
    share
        Share of each parameter's information that each output brings, shape (n_outputs, n).
    std_alone
        Standard deviation of each value were all others known, shape (n,).
    std_joint
        Standard deviation with all of them free, shape (n,); NaN where not identifiable.
    correlation
        Shape (n, n).
    not_identifiable
        Groups of names that these data cannot tell apart.
    quantities, units
        The quantity in whose unit each free parameter is shown, and that unit.
    """

    names: tuple[str, ...]
    outputs: tuple[str, ...]
    share: FloatArray
    std_alone: FloatArray
    std_joint: FloatArray
    correlation: FloatArray
    not_identifiable: tuple[tuple[str, ...], ...]
    quantities: tuple[Displayed, ...]
    units: tuple[str, ...]

    def __repr__(self) -> str:
        blind = few([", ".join(group) for group in self.not_identifiable])
        return f"<Sensitivity of {few(self.names)} to {few(self.outputs)}; not identifiable: {blind}>"

    def summary(self) -> str:
        """The table as text."""
        return text_table(*self.table())

    def table(self) -> Table:
        """A line for each parameter: its standard deviations in declared units, and what share each output brings."""
        rows = [
            [name, self.units[k], *map(number, self._std(k)), *(f"{share:.0%}" for share in self.share[:, k])]
            for k, name in enumerate(self.names)
        ]
        return ("parameter", "unit", "std alone", "std joint", *self.outputs), rows

    def to_dataframe(self) -> pandas.DataFrame:
        """The table as a data frame: ``unit``, ``std_alone``, ``std_joint``, and a column of shares for each output.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        alone, joint = zip(*(self._std(k) for k in range(len(self.names))), strict=True)
        shares = dict(zip(self.outputs, self.share, strict=True))
        return frame({"unit": self.units, "std_alone": alone, "std_joint": joint, **shares}, self.names, "parameter")

    def _std(self, k: int) -> tuple[float, float]:
        """Standard deviations of a parameter as they are shown: alone, and with all of them free."""
        show = self.quantities[k].shown
        return show(float(self.std_alone[k])), show(float(self.std_joint[k]))

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON holds it, in declared units; numbers that do not exist are null."""
        rows: Mapping[str, Any] = {
            name: {
                "unit": self.units[k],
                "std_alone": _finite(self._std(k)[0]),
                "std_joint": _finite(self._std(k)[1]),
                "share": {output: _finite(self.share[j, k]) for j, output in enumerate(self.outputs)},
                "correlation": {other: _finite(self.correlation[k, i]) for i, other in enumerate(self.names)},
            }
            for k, name in enumerate(self.names)
        }
        return {"parameters": rows, "not_identifiable": [list(group) for group in self.not_identifiable]}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def sensitivity(problem: Problem, point: FloatArray | None = None, jacobian: Expand = derivatives) -> Sensitivity:
    """What the logs of a problem can say about its free parameters.

    Parameters
    ----------
    problem
        Free parameters and logs; the times, inputs and gaps of the logs count, and where the model stands at ``point``.
        Of a joint problem outputs of one name are told together.
    point
        Coordinates, shape (n,); None: where searches start.
    jacobian
        Gives the information and the terms it comes from; by default exact derivatives where they repay.

    Raises
    ------
    EstimationError
        If the model diverges there, or the jacobian gives no terms.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> list(bg.sensitivity(bg.pose(swing, log, ["length", "damping"])).to_dict()["parameters"])
    ['length', 'damping']
    """
    require_kind("sensitivity", problem, (EstimationProblem, JointProblem), "posed problem")
    where = problem.start if point is None else point
    return sensitivity_from(problem, where, fitted_expansion(problem, where, jacobian))


def sensitivity_from(problem: Problem, where: FloatArray, expansion: Expansion) -> Sensitivity:
    """The same from an expansion at a point (n,) that is known already.

    Raises
    ------
    EstimationError
        If the expansion is not finite, or has no terms.
    """
    terms = expansion.terms
    if terms is None or not np.isfinite(expansion.information).all():
        raise EstimationError(
            f"{problem.name}: no sensitivities at this point, the model diverges there"
            " - start nearer to plausible values, or use more substeps",
            where=problem.names,
        )
    slopes = np.array([p.slope(value) for p, value in zip(problem.free, problem.values(where), strict=True)])
    information = np.diag(expansion.information)
    slopes_s = terms.log_scales[:, 1:]
    outputs, shares = _shares(problem, terms.innovations[:, 1:] + terms.innovations[:, :1] * slopes_s, slopes_s)
    known = uncertainty(problem, where, expansion, curvature=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        joint = np.sqrt(np.diag(known.covariance))
        return Sensitivity(
            names=problem.names,
            outputs=outputs,
            share=shares / information,
            std_alone=slopes / np.sqrt(information),
            std_joint=slopes * joint,
            correlation=known.covariance / np.outer(joint, joint),
            not_identifiable=tuple(tuple(problem.names[k] for k in group) for group in known.groups),
            quantities=tuple(quantity_of(problem, parameter) for parameter in problem.free),
            units=tuple(unit_of(problem, parameter) for parameter in problem.free),
        )


def _shares(problem: Problem, slopes_e: FloatArray, slopes_s: FloatArray) -> tuple[tuple[str, ...], FloatArray]:
    """Information of each parameter by output, shape (n_outputs, n); rows of terms run by part, log, output, sample."""
    per_row = slopes_e**2 + 2.0 * slopes_s**2
    sums: dict[str, FloatArray] = {}
    first = 0
    for part in problem.parts:
        names = part.filter_model.model.names("output")
        measured = {row for row in range(len(names)) if any(not np.isnan(log.y[row]).all() for log in part.logs)}
        for log in part.logs:
            size = len(names) * len(log)
            told = per_row[first : first + size].reshape(len(names), len(log), -1).sum(axis=1)
            for row in sorted(measured):
                sums[names[row]] = sums.get(names[row], 0.0) + told[row]
            first += size
    if first == per_row.shape[0]:
        return tuple(sums), np.array([*sums.values()]).reshape(len(sums), per_row.shape[1])
    return (*sums, "prior"), np.vstack([*sums.values(), per_row[first:].sum(axis=0)])
