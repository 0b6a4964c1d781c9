"""The folder of a design of experiments: result.json, design.png and discrimination.png, report.html."""

from __future__ import annotations

from pathlib import Path

from bondgraph.estimate.design.answer import Design
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


def write_design(answer: Design, folder: Path, made: Provenance) -> None:
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
