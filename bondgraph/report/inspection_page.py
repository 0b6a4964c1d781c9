"""The folder of an inspected log: result.json, a picture of all channels, report.html."""

from __future__ import annotations

from pathlib import Path

from bondgraph.data.log import Log
from bondgraph.files import finite, write_json
from bondgraph.report.figures import save_figure
from bondgraph.report.html import Provenance
from bondgraph.report.inspection import Inspection, channel_table, inspection_figure, inspection_notes, times_text
from bondgraph.report.page import Section, write_page


def write_inspection(log: Log, found: Inspection, folder: Path, made: Provenance) -> None:
    """Write ``result.json``, the picture ``NAME_channels.png`` and the page ``report.html`` into a folder.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    write_json(folder / "result.json", finite(found.to_dict()))
    figure = inspection_figure(log)
    save_figure(figure, folder / f"{found.log}_channels.png")
    sections = [Section("Channels", (), *channel_table(found)), Section("Over time", figure=figure)]
    nothing = ("Nothing is suspicious in units, times and values.",)
    answer = [times_text(found), *(inspection_notes(found) or nothing)]
    write_page(folder / "report.html", found.log, "What the log holds, without any model.", answer, sections, made)
