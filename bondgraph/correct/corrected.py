"""The corrected declaration: the model where a loop ends, with its estimated values, bounds and starts."""

from __future__ import annotations

from bondgraph.build import BuiltModel, build
from bondgraph.correct.evidence.replaced import beyond_declared
from bondgraph.correct.models.started import with_declared_starts, with_estimated_starts
from bondgraph.correct.progress import Progress
from bondgraph.declare.editing import with_bounds, with_values
from bondgraph.estimate.fitted import Fit


def corrected(nominal: Fit, state: Progress) -> tuple[BuiltModel, tuple[str, ...]]:
    """The corrected model with its estimated values, and the states whose starts no declaration can say.

    Starts are declared where fits had them from sensors and from other states; another rule says them by itself.
    """
    current = state.fit
    built = build(with_values(with_bounds(state.built.graph, _widened(nominal, current)), _model_values(current)))
    built = with_estimated_starts(built, {name: mean for name, (mean, _) in current.begun.items()})
    if current.problem.initial != "measured":
        return built, ()
    paths = [run.filtered_mean for run in current.runs(state.train)]
    return with_declared_starts(built, current.problem.filter_model.follows, state.train, paths)


def _model_values(fitted: Fit) -> dict[str, float]:
    return {
        parameter.name: fitted.values[parameter.name]
        for parameter in fitted.problem.free
        if parameter.target.kind == "parameter"
    }


def _widened(nominal: Fit, fitted: Fit) -> dict[str, tuple[float, float]]:
    """Bounds as the search left them: of coefficients, which only scale it, and of elements that a law replaces."""
    gone = beyond_declared(nominal, fitted)
    return {one.name: (one.lower, one.upper) for one in fitted.problem.free if one.widens or one.name in gone}
