"""How well are missing effects found? Simulated machines with a known effect, and the loop closed on each of them.

    python -m vehicle_graphs.effect_study --out study                           the vehicle, all: days on one core
    python -m vehicle_graphs.effect_study --out study --executor processes:8    on eight cores
    python -m vehicle_graphs.effect_study --out study --machine bench           a driveline that is quick to simulate
    python -m vehicle_graphs.effect_study --out study --machine road            the vehicle on an unknown road
    python -m vehicle_graphs.effect_study --out try --machine bench --families none --seeds 4 --short

Every case draws true parameters and drives, puts an effect of a wanted size into the declared graph, simulates logs
with sensor noise, and gives the declared graph with these logs to the closed loop, which knows nothing of the truth.
Then both are compared: place, effect, coefficient, what is said beside, error on a held-out log before and after. Sizes
are what a fit of the declared model leaves, in standard deviations of the sensor that shows most. An interrupted study
goes on where it stopped: each case is a file in the folder, and the tables are made of those that are there.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from bondgraph.errors import BondGraphError
from bondgraph.execute.executors import open_executor
from bondgraph.report.figures import save_figure
from bondgraph.report.page import Section, write_page
from bondgraph.report.progress import WorkProgress
from vehicle_graphs.chain_reports import Command
from vehicle_graphs.commands import command_parser
from vehicle_graphs.effect_study import tables
from vehicle_graphs.effect_study.cases import DESCRIPTIONS, FAMILIES, Case, all_cases
from vehicle_graphs.effect_study.machines import MACHINES
from vehicle_graphs.effect_study.picture import picture
from vehicle_graphs.effect_study.scoring import Outcome
from vehicle_graphs.effect_study.study import RENEWED, Study

SIZES = (0.3, 1.0, 3.0)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("effect_study", __doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the study, made if absent")
    parser.add_argument("--machine", choices=tuple(MACHINES), default="ranger", help="default: ranger")
    meaning = "; ".join(f"{name}: {what}" for name, what in DESCRIPTIONS.items())
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=FAMILIES, metavar="F", help=meaning)
    parser.add_argument(
        "--kinds", nargs="+", default=(), metavar="K", help='effects by label, as "slip at belt"; default: all'
    )
    parser.add_argument("--sizes", nargs="+", type=float, default=SIZES, metavar="S", help="default: 0.3 1 3")
    parser.add_argument("--seeds", type=int, default=10, metavar="N", help="cases of each kind and size; default: 10")
    parser.add_argument(
        "--first-seed", type=int, default=0, metavar="K",
        help="cases from this seed on, as those that a change of the loop was not judged by; default: 0",
    )  # fmt: skip
    parser.add_argument("--minutes", type=float, metavar="M", help="begin no case later than that")
    parser.add_argument("--short", action="store_true", help="logs of half the length")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input, 130 when interrupted."""
    options = _parser().parse_args(arguments)
    command = Command("effect_study", sys.argv[1:] if arguments is None else arguments)
    machine = MACHINES[options.machine]
    study = Study(options.out, machine.shortened() if options.short else machine)
    found: list[Outcome] = []
    interrupted = False
    try:
        cases = all_cases(
            study.machine, options.families, options.kinds, options.sizes, options.seeds, options.first_seed
        )
        options.out.mkdir(parents=True, exist_ok=True)
        _run(study, cases, options, found)
    except KeyboardInterrupt:
        interrupted = True
    except (BondGraphError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    counted = f"{machine.name}, {len(found)} of {len(cases)} cases"
    write(found, options.out)
    write_report(found, options.out, counted, command)
    print(f"{counted}\n\n{tables.text(found)}\n")
    print(f"written: {options.out / 'result.json'}, {options.out / 'confusion.png'}, {options.out / 'report.html'}")
    if interrupted:
        print(f"stopped; the same command goes on with what is in {options.out}", file=sys.stderr)
    return 130 if interrupted else 0


def _run(study: Study, cases: Sequence[Case], options: argparse.Namespace, found: list[Outcome]) -> None:
    """Take the cases; what is finished is in ``found`` even if they are interrupted."""
    until = None if options.minutes is None else time.monotonic() + 60.0 * options.minutes
    with (
        WorkProgress("closing loops", len(cases), "cases") as work,
        open_executor(options.executor, RENEWED) as executor,
    ):

        def done(outcome: Outcome) -> None:
            found.append(outcome)
            work.describe(outcome.subject)
            work.advance()

        study.run(cases, done, executor, until)


def write(found: Sequence[Outcome], folder: Path) -> None:
    """Write ``result.json`` and, where there are cases with one effect, ``confusion.png``."""
    ordered = sorted(found, key=lambda one: (FAMILIES.index(one.family), one.seed))
    (folder / "result.json").write_text(json.dumps(tables.result(ordered), indent=1), encoding="utf-8")
    if any(one.family == "effect" for one in ordered):
        save_figure(picture(ordered), folder / "confusion.png")


def write_report(found: Sequence[Outcome], folder: Path, counted: str, command: Command) -> None:
    """Write ``report.html``: the tables of the study with the picture of what was said."""
    sections = []
    for title, header, rows in tables.all_tables(found):
        head, colon, rest = f"{title[:1].upper()}{title[1:]}".partition(", by its size")
        text = [f"By its size{rest}."] if colon else []
        sections.append(Section(head, text, header if rows else (), rows))
    if any(one.family == "effect" for one in found):
        sections.insert(0, Section("What was said of every missing effect", figure=picture(found), scrolls=True))
    write_page(
        folder / "report.html", "Missing effects that are found",
        "Simulated machines with a known effect, and what the closed loop says of each.",
        [f"{counted}.", *(f"{one[:1].upper()}{one[1:]}." for one in tables.failures(found))], sections, command.made(),
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
