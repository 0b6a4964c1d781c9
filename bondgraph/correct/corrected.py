"""The corrected declaration: the model where a loop ends, with its estimated values, bounds and starts."""

from __future__ import annotations

from bondgraph.build import BuiltModel, build
from bondgraph.correct.models.started import with_declared_starts
from bondgraph.correct.progress import Progress
from bondgraph.declare.editing import with_bounds, with_values
from bondgraph.estimate.fitted import Fit


def corrected(state: Progress) -> tuple[BuiltModel, tuple[str, ...]]:
    """The corrected model with its estimated values, and the states whose starts no declaration can say.

    Starts are declared where fits had them from sensors and from other states; another rule says them by itself.
    """
    current = state.fit
    built = build(with_values(with_bounds(state.built.graph, _widened(current)), _model_values(current)))
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


def _widened(fitted: Fit) -> dict[str, tuple[float, float]]:
    """Bounds of coefficients as the search left them: it may have gone beyond those that scaled it."""
    return {one.name: (one.lower, one.upper) for one in fitted.problem.free if one.widens}
