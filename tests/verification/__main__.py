"""Published results against what the toolkit gives, as a table.

    python -m tests.verification [--cases FOLDER] [--only TEXT ...] [--json FILE]

One line per claim: the case and its source, the quantity, the value that is furthest off over its tolerance, what was
expected there, and the functions of the toolkit that gave it. Whether they ran is watched. The test suite checks the
same claims. The exit status is 1 when one differs.

The cases are data beside the checkout (../shared/data/published); without them there is nothing to compare.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.conftest import SHARED_DATA
from tests.verification.claims import Claim, Row, Verdict, answered, published
from tests.verification.table import CLAIMS

#: Columns of the table where it is not shown in a terminal.
_WIDTH = 230
_STYLES = {
    Verdict.HOLDS: "green",
    Verdict.DIFFERS: "bold red",
    Verdict.NOT_CALLED: "bold red",
    Verdict.NOT_EXPRESSIBLE: "yellow",
}


def main() -> int:
    """Answer the claims asked for and print them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, default=SHARED_DATA / "published", help="folder with cases.json")
    parser.add_argument(
        "--only", nargs="+", default=[""], metavar="TEXT", help="claims with one of these in their name"
    )
    parser.add_argument("--json", type=Path, help="write the lines here as well")
    options = parser.parse_args()
    if not (options.cases / "cases.json").is_file():
        print(
            f"verification: there is no cases.json in {options.cases} - name its folder with --cases", file=sys.stderr
        )
        return 0
    chosen = [claim for claim in CLAIMS if any(text in claim.name for text in options.only)]
    if not chosen:
        print(f"verification: no claim is called {' or '.join(options.only)}", file=sys.stderr)
        return 2
    rows = answers(chosen, options.cases)
    Console(width=None if sys.stdout.isatty() else _WIDTH).print(table(rows))
    print(summary(rows))
    if options.json:
        options.json.write_text(
            json.dumps([row.to_dict() for row in rows], indent=1, allow_nan=False), encoding="utf-8"
        )
    return int(any(row.verdict in (Verdict.DIFFERS, Verdict.NOT_CALLED) for row in rows))


def answers(claims: list[Claim], folder: Path) -> list[Row]:
    """The lines of some claims, told as they come."""
    cases, rows = published(folder), []
    for claim in claims:
        print(f"{claim.name} ...", file=sys.stderr, flush=True)
        rows.append(answered(claim, cases))
    return rows


def table(rows: list[Row]) -> Table:
    """The lines under their cases."""
    shown = Table(title="Published results and the toolkit's")
    shown.add_column("case, source", max_width=44)
    shown.add_column("quantity", max_width=30)
    for column in ("values", "expected", "got", "difference", "tolerance"):
        shown.add_column(column, justify="right", no_wrap=True)
    shown.add_column("where in the toolkit", overflow="fold")
    shown.add_column("verdict", max_width=34)
    case = ""
    for row in rows:
        if row.claim.case != case:
            shown.add_section()
        heading = "" if row.claim.case == case else f"[bold]{row.claim.case}[/]\n{row.source}"
        case = row.claim.case
        verdict = f"[{_STYLES[row.verdict]}]{row.verdict.value}[/]"
        if row.claim.reason:
            verdict += f": {row.claim.reason}"
        shown.add_row(heading, row.claim.about, *numbers(row), "\n".join(row.where), verdict)
    return shown


def numbers(row: Row) -> tuple[str, ...]:
    """Count, expected, got, difference and tolerance; nothing where nothing was computed."""
    if math.isnan(row.expected):
        return ("",) * 5
    pair = (f"{value:.12g}" for value in (row.expected, row.got))
    return str(row.values), *pair, f"{row.got - row.expected:.1e}", row.tolerance


def summary(rows: list[Row]) -> str:
    """How many claims stand how."""
    counts = {verdict: sum(row.verdict is verdict for row in rows) for verdict in Verdict}
    return ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)


if __name__ == "__main__":
    sys.exit(main())
