"""The estimation problem of a declared model: free parameters by name, noises from the logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.free import FreeParameter, declared_free, parse_target
from bondgraph.estimate.initial import Initial
from bondgraph.estimate.inputs_before import with_inputs_before
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import FilterSetup, filter_setup
from bondgraph.simulate.model import Model


def declared_problem(
    model: Model,
    driven: Sequence[str],
    logs: Sequence[MatchedLog],
    free: Sequence[str | FreeParameter],
    process_noise: str,
    initial: Initial = "measured",
) -> EstimationProblem:
    """The estimation problem that a command poses: noises from the logs, the named parameters or all with bounds free.

    Steps of a stiff model are planned along the logs (:func:`bondgraph.filter.choice.choose_method`).

    Raises
    ------
    EstimationError
        If a name is unknown or has no bounds.
    """
    logs = with_inputs_before(model, logs, model.theta(), initial)
    setup = filter_setup(model, driven, logs, process_noise)
    names = [one for one in free if isinstance(one, str)]
    wanted = [name for name in names if parse_target(name).kind == "parameter"]
    named = free_parameters(setup, wanted) if wanted or not free else ()
    levels = [name for name in names if parse_target(name).kind != "parameter"]
    others = [one for one in free if isinstance(one, FreeParameter)]
    others += [declared_free(name, setup.filter_model, logs=logs) for name in levels]
    given = {parameter.name for parameter in others}
    noise = [parameter for parameter in setup.noise if parameter.name not in given]
    declared = setup.filter_model
    filter_model = replace(declared, method="auto", substeps=1, grading=1.0) if declared.is_stiff else declared
    return EstimationProblem(filter_model, tuple(logs), (*named, *others, *noise), initial)


def free_parameters(setup: FilterSetup, names: Sequence[str]) -> tuple[FreeParameter, ...]:
    """The named parameters, or all that declare bounds; starts at a bound are moved inside."""
    model = setup.filter_model.model
    chosen = tuple(names) or tuple(info.name for info in model.parameters if info.lower is not None)
    if not chosen:
        raise EstimationError(
            f"{model.name}: no parameter declares bounds, so nothing is free - declare bounds, or name some with --free"
        )
    return tuple(declared_free(name, setup.filter_model) for name in chosen)
