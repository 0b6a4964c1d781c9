"""The command that shows the dictionary of effects."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from bondgraph.effects.catalogue import catalogue, named
from bondgraph.effects.curves import curve_of
from bondgraph.errors import OptionError
from bondgraph.files import output_file
from bondgraph.report.dictionary import entry_text, law_figure, table_json, table_text
from bondgraph.report.figures import save_figure


def effects(options: argparse.Namespace) -> int:
    """List all effects, or show one with its formula and picture."""
    if options.picture and not options.name:
        raise OptionError("--picture: name the effect that is to be drawn", where=("--picture",))
    rows = named(options.name) if options.name else catalogue()
    if options.domain:
        rows = tuple(row for row in rows if {options.domain, "every"} & set(row.domains))
    if options.json:
        print(json.dumps(table_json(rows), indent=1))
    elif options.name:
        print("\n\n".join(entry_text(row) for row in rows))
    else:
        print(table_text(rows))
        print("\n* tried only where --effects names it; bondgraph effects NAME says more of one")
    if options.picture:
        target = output_file(Path(options.picture))
        curve = next((found for row in rows if (found := curve_of(row)) is not None), None)
        if curve is None:
            raise OptionError(
                f"--picture: {options.name} acts in time, which no curve over one variable shows - leave it out",
                where=("--picture", options.name),
            )
        save_figure(law_figure(rows[0], curve), target)
        print(f"drawn: {target}")
    return 0
