"""Beliefs of a filter or smoother as a user reads them: by name, in declared units."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.filter_model import FilterModel
from bondgraph.shown import own_axes
from bondgraph.simulate.quantities import ParameterInfo, StateInfo
from bondgraph.text import Table, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def belief_columns(filter_model: FilterModel, mean: FloatArray, variance: FloatArray) -> dict[str, FloatArray]:
    """Means and standard deviations (n,) of each state in its declared unit, by ``name [unit]`` as in logs.

    Parameters
    ----------
    filter_model
        Whose states these are.
    mean, variance
        Both (n_s, n).
    """
    std = np.sqrt(np.maximum(variance, 0.0))
    columns = {}
    for info, values, deviations in zip(_infos(filter_model), mean, std, strict=True):
        columns[f"{info.name} [{info.display_unit or 1}]"] = info.shown(values)
        columns[f"{info.name}_std [{info.display_unit or 1}]"] = info.shown(deviations)
    return columns


def belief_table(filter_model: FilterModel, mean: FloatArray, variance: FloatArray) -> Table:
    """A line for each state: first and last mean with their standard deviations; arguments as above."""
    columns = list(belief_columns(filter_model, mean, variance).values())
    rows = [
        [info.name, info.display_unit or "1", *(number(float(one[k])) for k in (0, -1) for one in (values, deviations))]
        for info, values, deviations in zip(_infos(filter_model), columns[::2], columns[1::2], strict=True)
    ]
    return ("state", "unit", "start", "std", "end", "std"), rows


def _infos(filter_model: FilterModel) -> list[StateInfo | ParameterInfo]:
    """States, then appended parameters."""
    model = filter_model.model
    return [*model.states, *(model.parameters[model.index("parameter", name)] for name in filter_model.appended)]


def belief_axes(
    filter_model: FilterModel, name: str, time: FloatArray, mean: FloatArray, std: FloatArray, ax: Axes | None
) -> Axes:
    """Mean (n,) of a state or appended parameter over time with two standard deviations, in its declared unit."""
    axes = own_axes(ax)
    info = _infos(filter_model)[filter_model.state_names.index(name)]
    shown, reach = info.shown(mean), 2.0 * info.shown(std)
    axes.fill_between(time, shown - reach, shown + reach, alpha=0.25, linewidth=0.0, label="two deviations")
    axes.plot(time, shown, label=name)
    axes.set(xlabel="time [s]", ylabel=f"{name} [{info.display_unit or 1}]")
    axes.legend(loc="best", fontsize="small")
    return axes
