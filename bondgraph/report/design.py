"""The folder of a design of experiments: result.json, design.png and discrimination.png, report.html."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bondgraph.estimate.design.discrimination import DiscriminationTable
from bondgraph.estimate.design.information import DesignTable
from bondgraph.files import write_json
from bondgraph.report.figures import save_figure
from bondgraph.report.html import Provenance
from bondgraph.report.page import Section, drawn, write_page

_READING = (
    "D: nats by which a log is expected to narrow the parameters beside what is known before. A: mean share of the "
    "variance of each parameter that is left. E: share of the standard deviation left along the direction that is told "
    "worst.",
)
_RIVALS = (
    "Nats: expected log-likelihood ratio of the true model over its rival, whose parameters are at their best, for the "
    "pair that is told apart worst.",
)


@dataclass(frozen=True)
class DesignAnswer:
    """What manoeuvres tell of the parameters of a model, and of rivals if there are any."""

    model: str
    information: DesignTable
    discrimination: DiscriminationTable | None = None

    @property
    def advice(self) -> tuple[str, ...]:
        """What to drive, in sentences."""
        rivals = (self.discrimination.advice,) if self.discrimination else ()
        return (*rivals, *self.information.advice())

    def text(self) -> str:
        """All tables as a terminal shows them."""
        parts = [self.information.summary()]
        parts += [self.discrimination.summary()] if self.discrimination else []
        return "\n\n".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """All numbers as JSON holds them."""
        found: dict[str, Any] = {"information": self.information.to_dict()}
        return found | ({"discrimination": self.discrimination.to_dict()} if self.discrimination else {})


def write_design(answer: DesignAnswer, folder: Path, made: Provenance) -> None:
    """Write ``result.json``, pictures and ``report.html`` into a folder, made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "result.json", answer.to_dict())
    table, rows = answer.information, len(answer.information.rows)
    figure = drawn(table.plot, 6.0 + 0.55 * len(table.names), 1.8 + 0.36 * rows)
    save_figure(figure, folder / "design.png")
    sections = [Section("What each manoeuvre tells", _READING, *table.table(), figure)]
    if answer.discrimination:
        picture = drawn(answer.discrimination.plot, 8.0, 1.4 + 0.36 * rows)
        save_figure(picture, folder / "discrimination.png")
        sections.append(Section("Rival models", _RIVALS, *answer.discrimination.table(), picture))
    subtitle = "What planned manoeuvres would tell, before anybody drives them."
    write_page(folder / "report.html", answer.model, subtitle, answer.advice, sections, made)
