"""The context of refits: what all of a round share, and the coordinates that they have in common."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from bondgraph.build import BuiltModel
from bondgraph.correct.models.candidates import Candidate, Variant
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal
from bondgraph.filter.filter_model import FilterModel


@dataclass(frozen=True)
class Context:
    """Context of the refits of a round, the same for all of them.

    ``base`` is the fit without any candidate, ``tried`` how many were tried, ``required`` the gain in nats that passes
    the tests (:func:`bondgraph.correct.evidence.decide.hurdle`), ``quiet`` the fit with little process noise,
    ``substeps`` the steps from which halvings are counted, see :func:`bondgraph.correct.evidence.certified.resolving`.
    ``formed`` are signals in which no law gets a regime, since the form of a law that stores shows there.
    """

    built: BuiltModel
    base: Fit
    train: tuple[MatchedLog, ...]
    tried: int
    level: float
    required: float
    journal: Journal = field(default_factory=Journal)
    quiet: Fit | None = None
    substeps: int | None = None
    formed: frozenset[str] = frozenset()


def coefficients(
    candidate: Candidate, filter_model: FilterModel, variant: Variant | None = None
) -> tuple[FreeParameter, ...]:
    """Coefficients and shapes of a candidate as free parameters; linear where zero is where they begin.

    Bounds of coefficients only scale the search.

    Raises
    ------
    EstimationError
        If one has no bounds.
    """
    shapes = {} if variant is None else variant.shapes
    model = filter_model.model
    found = []
    for name in candidate.effect.parameters:
        lower, upper = candidate.bounds(name)
        value = shapes.get(name, model.parameters[model.index("parameter", name)].value)
        scale: Literal["linear", "log"] = "log" if lower > 0.0 else "linear"
        widens = name in candidate.effect.coefficients
        found.append(FreeParameter(name, lower, upper, value, scale=scale, widens=widens))
    return tuple(found)


def declared_point(base: Fit) -> FloatArray:
    """The point of a fit with its parameters as declared, shape (n,)."""
    model = base.problem.filter_model.model
    point = base.point.copy()
    for k, parameter in enumerate(base.problem.free):
        if parameter.target.kind == "parameter":
            value = model.parameters[model.index("parameter", parameter.target.name)].value
            point[k] = parameter.coordinate(float(np.clip(value, parameter.lower, parameter.upper)))
    return point


def inside(coefficient: FreeParameter, step: float) -> float:
    """A coefficient where its score points, inside its bounds and by no more than half their width."""
    reach = 0.5 * (coefficient.upper - coefficient.lower)
    margin = 1e-6 * reach
    value = coefficient.start + float(np.clip(step, -reach, reach))
    return float(np.clip(value, coefficient.lower + margin, coefficient.upper - margin))
