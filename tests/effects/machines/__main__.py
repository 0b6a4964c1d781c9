"""Small machines of every domain, truths by scipy, answered by a loop with default options, as a table.

    python -m tests.effects.machines [--only NAME ...] [--json FILE]

Two lines per machine: with its effect, and without. The exit status is 1 when something wrong is named.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.effects.machines.count import KINDS, Answer, asked
from tests.effects.machines.machine import Machine

#: Columns of the table where it is not shown in a terminal.
_WIDTH = 200


def main() -> int:
    """Ask for the machines chosen and print the answers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME", help="kinds or machines with one of these")
    parser.add_argument("--json", type=Path, help="write the lines here as well, after each machine")
    options = parser.parse_args()
    chosen = {
        (kind, name): machine
        for kind, known in KINDS.items()
        for name, machine in known.items()
        if any(text in f"{kind} {name}" for text in options.only)
    }
    if not chosen:
        print(f"machines: none is called {' or '.join(options.only)}", file=sys.stderr)
        return 2
    found: list[Answer] = []
    for (_, name), machine in chosen.items():
        for effect in (True, False):
            print(f"{name} {'with' if effect else 'without'} its effect ...", file=sys.stderr, flush=True)
            found.append(asked(name, machine, effect))
        if options.json:
            options.json.write_text(json.dumps([asdict(one) for one in found], indent=1), encoding="utf-8")
    Console(width=None if sys.stdout.isatty() else _WIDTH).print(table(chosen, found))
    print(summary(found))
    return int(any(one.wrong for one in found))


def table(machines: dict[tuple[str, str], Machine], found: list[Answer]) -> Table:
    """The answers under the kinds of machines."""
    shown = Table(title="Small machines and what a loop says of them")
    for column in ("machine", "truth", "verdict", "named", "size"):
        shown.add_column(column, overflow="fold")
    shown.add_column("CPU s", justify="right")
    shown.add_column("", no_wrap=True)
    answers = iter(found)
    last = ""
    for (kind, name), machine in machines.items():
        if kind != last:
            shown.add_section()
            shown.add_row(f"[bold]{kind}[/]")
        last = kind
        for truth in (machine.effect, "nothing"):
            one = next(answers)
            mark = "[green]right[/]" if one.right else "[bold red]wrong[/]" if one.wrong else "[yellow]missed[/]"
            named, sizes = "\n".join(one.named), "\n".join(one.sizes)
            shown.add_row(name, truth, one.verdict, named, sizes, f"{one.seconds:.0f}", mark)
    return shown


def summary(found: list[Answer]) -> str:
    """The counts in one line."""
    own, twins = [one for one in found if one.effect], [one for one in found if not one.effect]
    return (
        f"{sum(one.right for one in own)} of {len(own)} right ({sum(one.strict for one in own)} without laws that"
        f" complete another), {sum(one.wrong for one in own)} wrong;"
        f" {sum(one.right for one in twins)} of {len(twins)} clean, {sum(one.wrong for one in twins)} false alarms;"
        f" at most {max(one.seconds for one in found):.0f} s of CPU"
    )


if __name__ == "__main__":
    sys.exit(main())
