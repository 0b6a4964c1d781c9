"""Profiles of an estimate in its folder: profile.png with a panel each, profile.json."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from bondgraph.estimate.likelihood_profile import LikelihoodProfile
from bondgraph.report.closed_loop import write_json
from bondgraph.report.figures import figure_style, save_figure

_COLUMNS, _WIDTH, _HEIGHT = 3, 3.6, 2.7


def profile_figure(profiles: Sequence[LikelihoodProfile]) -> Figure:
    """A panel for each profile, three in a row, in declared units."""
    columns = min(_COLUMNS, len(profiles))
    rows = math.ceil(len(profiles) / columns)
    with figure_style():
        figure = Figure(figsize=(_WIDTH * columns, _HEIGHT * rows + 0.2), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for one, axes in zip(profiles, panels, strict=False):
            one.plot(axes)
        for axes in panels[len(profiles) :]:
            axes.set_axis_off()
        panels[0].legend(loc="upper center", fontsize="small")
    return figure


def write_profiles(profiles: Sequence[LikelihoodProfile], folder: Path) -> Path:
    """Write ``profile.png`` and ``profile.json`` into a folder; the path of the picture."""
    save_figure(profile_figure(profiles), folder / "profile.png")
    write_json(folder / "profile.json", {one.name: _as_json(one) for one in profiles})
    return folder / "profile.png"


def _as_json(one: LikelihoodProfile) -> dict[str, Any]:
    return {
        "unit": one.unit, "level": one.level, "value": one.show(one.value), "evaluations": one.evaluations,
        "interval": [one.show(end) for end in one.interval], "open": list(one.bounded), "verdict": one.verdict,
        "curve": [[one.show(float(v)), float(d)] for v, d in zip(one.values, one.deviance, strict=True)],
    }  # fmt: skip
