"""Profiles of an estimate as files: beside the estimate profile.png and profile.json, or a folder of their own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from bondgraph.estimate.likelihood_profile import LikelihoodProfile, profile_table
from bondgraph.estimate.result import Estimate
from bondgraph.files import write_json
from bondgraph.report.figures import figure_style, save_figure
from bondgraph.report.html import Provenance
from bondgraph.report.page import Section, write_page
from bondgraph.text import number, text_table

#: Panels beside each other, and inches of one: both stand in a window of half a screen, 800 pixels.
_COLUMNS, _WIDTH, _HEIGHT = 2, 3.6, 2.7


def profile_figure(profiles: Sequence[LikelihoodProfile]) -> Figure:
    """A panel for each profile, two in a row, in declared units."""
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
        "curve": [[one.show(float(v)), _finite(float(d))] for v, d in zip(one.values, one.deviance, strict=True)],
    }  # fmt: skip


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class ProfileAnswer:
    """An estimate and the profiles of its parameters."""

    estimate: Estimate
    profiles: tuple[LikelihoodProfile, ...]

    def sentences(self) -> list[str]:
        """Sentences on profiles that are open, that differ from the curvature, and that agree with it."""
        agree = [one.name for one in self.profiles if not one.verdict and not one.better]
        said = [line for one in self.profiles for line in _sentences(one)]
        said += [f"Profile and curvature agree: {', '.join(agree)}."] if agree else []
        return [*said, _OPEN] if any(any(one.bounded) for one in self.profiles) else said

    def text(self) -> str:
        """Table and sentences as a terminal shows them."""
        return "\n".join([text_table(*profile_table(self.profiles)), *self.sentences()])

    def to_dict(self) -> dict[str, Any]:
        """All numbers as JSON holds them, in declared units; numbers that do not exist are null."""
        found = self.estimate
        return {
            "parameters": {one.name: _with_curvature(one) for one in self.profiles},
            "said": self.sentences(),
            "nll": _finite(found.nll),
            "outcome": found.end,
            "converged": found.outcome.succeeded,
            "uncertainty": found.uncertainty_outcome.value,
            "discretisation": found.certification.to_dict(),
            "evaluations": found.evaluations + sum(one.evaluations for one in self.profiles),
            "logs": [log.name for log in found.problem.logs],
        }


def write_profile_answer(answer: ProfileAnswer, folder: Path, made: Provenance) -> None:
    """Write ``result.json``, ``profile.png`` and ``report.html`` into a folder, made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "result.json", answer.to_dict())
    figure = profile_figure(answer.profiles)
    save_figure(figure, folder / "profile.png")
    found = answer.estimate
    estimated = (found.end, f"Negative log-likelihood {found.nll:.4f}; covariance {found.uncertainty_outcome.value}.")
    sections = [
        Section("Profiles", _READING, *profile_table(answer.profiles), figure, scrolls=True),
        Section("The estimate", estimated, *found.table()),
    ]
    subtitle = "How far each parameter can go while all others make the best of it."
    write_page(folder / "report.html", found.problem.name, subtitle, answer.sentences(), sections, made)


#: How table and picture are read.
_READING = (
    "A profile raises the likelihood again at each value of one parameter. The interval ends where twice the rise of "
    "the negative log-likelihood reaches the quantile (the horizontal line); the dashed parabola is what the "
    "covariance of the estimate says.",
)

#: Advice on open profiles.
_OPEN = (
    "An end that is open is the bound, and no answer of the data: wider bounds (--free NAME=LOWER:UPPER) show how far "
    "they reach, bondgraph design says which run would tell more, and what is known from elsewhere is a --prior."
)


def _sentences(one: LikelihoodProfile) -> list[str]:
    """Sentences on the profile of one parameter beside its numbers."""
    unit = "" if one.unit in ("", "1") else f" {one.unit}"
    said = _open(one, unit)
    if any(one.differs) and math.isfinite(one.std):
        said.append(
            f"{one.name} is {_ends(one.interval, one)}{unit} by the profile and {_ends(one.curvature, one)}{unit} by "
            "the curvature: the likelihood is no parabola there, and the profile holds."
        )
    elif any(one.differs):
        said.append(
            f"{one.name} is {_ends(one.interval, one)}{unit} by the profile, and the curvature does not tell it within "
            "its bounds."
        )
    if one.better:
        said.append(
            f"The profile of {one.name} finds a point that is better by {one.better:.2g} nats: the estimate is no "
            "optimum - search again with more --starts, or by another --method."
        )
    return said


def _open(one: LikelihoodProfile, unit: str) -> list[str]:
    """A sentence for each side on which the likelihood does not end the profile before its bound."""
    ends = tuple(number(one.show(end)) for end in one.interval)
    at_bound = [end == one.value for end in one.interval]
    if all(one.bounded) and not any(at_bound):
        return [
            f"{one.name} is open on both sides: the data forbid no value in its bounds, {ends[0]} to {ends[1]}{unit}."
        ]
    sides = (("below", "down"), ("above", "up"))
    return [
        f"{one.name} is open {side}: it rests on its bound, {end}{unit}, and the data may lead beyond it." if rests
        else f"{one.name} is open {side}: the data forbid no value {way} to its bound, {end}{unit}."
        for (side, way), end, rests, bounded in zip(sides, ends, at_bound, one.bounded, strict=True)
        if bounded
    ]  # fmt: skip


def _ends(interval: tuple[float, float], one: LikelihoodProfile) -> str:
    return " to ".join(number(one.show(end)) for end in interval)


def _with_curvature(one: LikelihoodProfile) -> dict[str, Any]:
    known = math.isfinite(one.std)
    return {
        **_as_json(one),
        "std": one.show(one.std) - one.shown[1] if known else None,
        "curvature": [one.show(end) for end in one.curvature] if known else [None, None],
        "differs": list(one.differs),
    }
