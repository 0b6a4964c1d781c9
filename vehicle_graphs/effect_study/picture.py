"""The picture of a study: what was said of every effect, and how often the right thing over the size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bondgraph.report.figures import AFTER, BEFORE, MEASURED, figure_style
from vehicle_graphs.effect_study.scoring import Outcome
from vehicle_graphs.effect_study.tables import is_right, share

#: Inches that the label of the curve's axis needs beside the names below the matrix.
_LEAST_HEIGHT = 4.6
#: Columns for answers that name nothing.
_UNNAMED = ("unexplained", "none", "failed")
#: An effect that was named at most so often and is none of the true ones goes to the column of the others.
_OTHERS = "another"


def picture(outcomes: Sequence[Outcome]) -> Figure:
    """The confusion matrix of all cases with one effect, blue where effect and place or their group are right."""
    main = [one for one in outcomes if one.family == "effect"]
    labels = list(dict.fromkeys(one.subject for one in main))
    with figure_style():
        figure = Figure(
            figsize=(8.5 + 0.36 * len(labels), max(3.0 + 0.3 * len(labels), _LEAST_HEIGHT)), layout="constrained"
        )
        matrix, curve = figure.subplots(1, 2, width_ratios=(2.0 + 0.08 * len(labels), 1.3))
        _confusion(matrix, main, labels)
        _detection(curve, main, labels)
    return figure


def _confusion(axes: Axes, outcomes: Sequence[Outcome], labels: list[str]) -> None:
    columns = [*labels, _OTHERS, *_UNNAMED]
    counts = np.zeros((len(labels), len(columns)), dtype=int)
    right = np.zeros_like(counts)
    for one in outcomes:
        for hit in one.hits:
            name = hit.found if hit.found in labels else (_OTHERS if hit.found else hit.answer)
            at = labels.index(hit.label), columns.index(name)
            counts[at] += 1
            right[at] += hit.is_right
    for (row, column), count in np.ndenumerate(counts):
        if count:
            wrong = count - right[row, column]
            colour = AFTER if not wrong else (MEASURED if columns[column] in _UNNAMED else BEFORE)
            strength = 0.15 + 0.85 * count / counts[row].sum()
            axes.scatter(column, row, s=230.0, marker="s", color=colour, alpha=strength, linewidths=0.0)
            axes.text(column, row, str(count), ha="center", va="center", fontsize=7.5)
    axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right")
    axes.set_yticks(range(len(labels)), labels)
    axes.set_xlim(-0.7, len(columns) - 0.3)
    axes.set_ylim(len(labels) - 0.3, -0.7)
    axes.set_title("what was said (across) of what is missing (down)")
    axes.set_xlabel("blue: right, or its group; orange: another effect; grey: nothing named")


def _detection(axes: Axes, outcomes: Sequence[Outcome], labels: list[str]) -> None:
    sizes = sorted({one.size for one in outcomes})
    for label in labels:
        own = [[one for one in outcomes if (one.subject, one.size) == (label, size)] for size in sizes]
        known = [
            (size, 100.0 * share(group, is_right)["share"]) for size, group in zip(sizes, own, strict=True) if group
        ]
        axes.plot(*np.array(known).T, color=MEASURED, linewidth=0.7, alpha=0.6)
    rates = [share([one for one in outcomes if one.size == size], is_right) for size in sizes]
    middle = np.array([100.0 * one["share"] for one in rates])
    reach = np.abs(np.array([[100.0 * one[end] for one in rates] for end in ("low", "high")]) - middle)
    axes.errorbar(sizes, middle, yerr=reach, color=AFTER, marker="o", capsize=4, linewidth=1.8, label="all kinds")
    axes.axhline(95.0, color=BEFORE, linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xticks(sizes, [f"{size:g}" for size in sizes])
    axes.minorticks_off()
    axes.set_ylim(-3.0, 103.0)
    axes.set_xlabel("size left by a fit of the declared model,\nover noise")
    axes.set_ylabel("right effect and place, or their group [%]")
    axes.set_title("found, by size (grey: each kind)")
    axes.legend(loc="lower right")
