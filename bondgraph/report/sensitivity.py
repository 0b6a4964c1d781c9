"""The folder of a sensitivity analysis: result.json, sensitivity.png, report.html."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bondgraph.estimate.analysis.ranking import Ranking
from bondgraph.estimate.analysis.rates import RateTable
from bondgraph.estimate.analysis.screening import GlobalSensitivity
from bondgraph.files import write_json
from bondgraph.report.figures import save_figure
from bondgraph.report.html import Provenance
from bondgraph.report.page import Section, drawn, write_page


@dataclass(frozen=True)
class SensitivityAnswer:
    """Parts of a sensitivity analysis: the ranking at one point, responses over the bounds, and rates of samples."""

    model: str
    ranking: Ranking
    screened: tuple[GlobalSensitivity, ...] = ()
    rates: RateTable | None = None

    def text(self) -> str:
        """All tables as a terminal shows them."""
        parts = [self.ranking.summary(), *(one.summary() for one in self.screened)]
        parts += [f"{self.rates.summary()}\n{_RATES}"] if self.rates else []
        return "\n\n".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """All numbers as JSON holds them."""
        found = self.ranking.to_dict()
        found |= {"global": [one.to_dict() for one in self.screened]} if self.screened else {}
        return found | (self.rates.to_dict() if self.rates else {})


def write_sensitivity(answer: SensitivityAnswer, folder: Path, made: Provenance) -> None:
    """Write ``result.json``, ``sensitivity.png`` and ``report.html`` into a folder, made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "result.json", answer.to_dict())
    count = len(answer.ranking.parameters)
    picture = drawn(answer.ranking.plot, 8.0, 1.3 + 0.32 * count)
    save_figure(picture, folder / "sensitivity.png")
    sections = [
        Section("At the start of an estimation", _READING, *answer.ranking.table(), picture),
        *(_screened(one) for one in answer.screened),
    ]
    if answer.rates:
        figure = drawn(answer.rates.plot)
        save_figure(figure, folder / "rates.png")
        sections.append(Section("Rate of samples", (answer.rates.verdict, _RATES), *answer.rates.table(), figure))
    subtitle = "What these logs say about each parameter before anything is estimated."
    write_page(folder / "report.html", answer.model, subtitle, answer.ranking.advice(), sections, made)


#: How the first table is read.
_READING = (
    "Known before: the standard deviation of a prior, or of a uniform law over the bounds. Nats: what an error of that "
    "size costs. Alone: with all other parameters known; joint: with all free; if freed: with only those free that "
    "should be.",
)

#: Why deviations of the table of rates are not those of the first table.
_RATES = (
    "Deviations by rate are those of logs that the model explains with these values and noises; the first table takes "
    "the logs as they are. Where the two differ much the values are far from what the logs say: estimate first, and "
    "look again with --set NAME=VALUE."
)


def _screened(one: GlobalSensitivity) -> Section:
    figure = drawn(one.plot, 7.5, 1.4 + 0.34 * len(one.names))
    return Section(f"Over the whole bounds: {one.response}", (one.title, *one.advice()), *one.table(), figure)
