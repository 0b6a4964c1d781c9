"""The folder that a command writes its answer to."""

from __future__ import annotations

import argparse
from pathlib import Path

from bondgraph.errors import OptionError
from bondgraph.files import output_folder


def answer_folder(options: argparse.Namespace) -> Path:
    """The folder of ``--out``, made where it is missing.

    Commands call the files of their answers alike, so that one would replace half of another's answer, and the hours
    that it took. A command that is called again replaces its own.

    Raises
    ------
    OptionError
        If it is a file, nothing can be written there, or it holds the report of another command.
    """
    folder = Path(options.out)
    writer = _writer(folder)
    if writer not in ("", options.command):
        raise OptionError(
            f"{folder}: holds the answer of bondgraph {writer}, which this one would overwrite - name another folder "
            "with --out",
            where=(str(folder),),
        )
    options.new_folders = [one for one in (folder, *folder.parents) if not one.exists()]
    return output_folder(folder)


def without_empty_folders(options: argparse.Namespace) -> None:
    """Take back the folders that a command made for an answer which it then had to refuse."""
    for folder in getattr(options, "new_folders", ()):
        try:
            folder.rmdir()
        except OSError:  # something stands in it
            return


def _writer(folder: Path) -> str:
    """The command whose report a folder holds; none where there is no report, or one that cannot be read."""
    from bondgraph.report.html import ReportData  # rooms that a folder without a report does without
    from bondgraph.report.saved import NAME, load_data

    if not (folder / NAME).is_file():
        return ""
    try:
        made = load_data(ReportData, folder / NAME).made
    except OptionError:
        return ""
    words = made.command.replace("bondgraph.", "bondgraph ").replace("_", "-").split() if made else []
    return words[1] if words[:1] == ["bondgraph"] and len(words) > 1 else ""
