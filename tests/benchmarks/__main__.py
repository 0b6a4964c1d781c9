"""Benchmarks: ratios of CPU times that are measured side by side in one run.

    python -m tests.benchmarks [--json FILE] [--rounds N] [--seconds S] [--only PART ...]

Prints tables and, if asked, writes all numbers as JSON. Keys that contain ``ratio`` say how many times less CPU time
this toolkit takes.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tests.benchmarks.cases import masses, ranger
from tests.benchmarks.gradient_rows import gradient
from tests.benchmarks.likelihood_rows import against_c, against_others, growth, methods
from tests.benchmarks.loop_rows import loop
from tests.benchmarks.start_rows import start

PARTS = ("start", "others", "c", "methods", "gradient", "growth", "loop")


def main() -> None:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write all numbers here")
    parser.add_argument("--rounds", type=int, default=5, help="rounds whose median counts (default 5)")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the drive (default 20 s)")
    parser.add_argument("--masses", type=int, nargs="*", default=[5, 10, 20, 50], help="lengths of the chains")
    parser.add_argument("--only", nargs="*", default=PARTS, choices=PARTS)
    options = parser.parse_args()
    found: dict[str, object] = {}
    case = ranger(options.seconds)
    if "start" in options.only:
        found["start"] = show_numbers("first likelihood in a process", start())
    if "others" in options.only:
        found["others"] = show_numbers(
            "one likelihood, Runge-Kutta with 25 steps", against_others(case, options.rounds)
        )
    if "c" in options.only:
        found["c"] = show_numbers("Runge-Kutta steps against C from the same equations", against_c(options.rounds))
    if "methods" in options.only:
        found["methods"] = show_rows("methods", methods(case, options.rounds))
    if "gradient" in options.only:
        found["gradient"] = show_numbers("gradient", gradient(case, options.rounds))
    if "growth" in options.only:
        chains = {count: masses(count) for count in options.masses}
        found["growth"] = show_rows("growth", growth(chains, options.rounds))
    if "loop" in options.only:
        found["loop"] = show_numbers("closed loop on the vehicle", loop(300.0))
    if options.json:
        options.json.write_text(json.dumps(found, indent=1), encoding="utf-8")


def show_numbers(title: str, numbers: dict[str, float]) -> dict[str, float]:
    """Print one number per line."""
    print(f"\n{title}")
    for name, value in numbers.items():
        print(f"  {name:<42} {value:12.4g}", flush=True)
    return numbers


def show_rows(title: str, rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """Print a table."""
    print(f"\n{title}\n  " + "".join(f"{name:>22}" for name in rows[0]))
    for row in rows:
        print(
            "  " + "".join(f"{v:>22}" if isinstance(v, str | int) else f"{v:>22.4g}" for v in row.values()), flush=True
        )
    return rows


if __name__ == "__main__":
    main()
