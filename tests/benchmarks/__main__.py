"""Benchmarks: ratios of CPU times that are measured side by side in one run.

    python -m tests.benchmarks [--quick] [--only PART ...] [--json FILE] [--rounds N]

Prints tables and, if asked, writes all numbers as JSON after every part. Keys that contain ``ratio`` say how many times
less CPU time this toolkit takes. The whole takes about half an hour on two cores, ``--quick`` a few minutes.

    start      first likelihood in a process, with an empty and a filled cache
    others     one likelihood against filterpy, numpy and scalar numba, and the equality of their values
    c, jax     the same steps in C (if gcc is there) and JAX (if installed)
    methods    stiff methods against Runge-Kutta at a certified shift of the estimate, on the vehicle's driveline
    failures   members that are not finite, over the box of the parameters and four spreads of the sigma points
    gradient   the gradient against values
    online     samples taken one by one against the same samples as a log
    growth     time against states, samples and members
    loop       a whole closed loop, the dictionary of effects on a drive
    optimisers global searches on test functions in ten dimensions, beside scipy and pyswarms (if installed)
    exploring  which search explores for gradient searches: swarm against L-SHADE, functions and drives of the vehicle
    search     the thesis' swarm of 8080 evaluations and the gradient search, eight parameters, 90 s of data
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tests.benchmarks.cases import driveline_drive, ranger
from tests.benchmarks.exploring_rows import exploring_drives, exploring_functions
from tests.benchmarks.gradient_rows import gradient
from tests.benchmarks.likelihood_rows import against_c, against_others, growth, growth_of_work
from tests.benchmarks.loop_rows import loop
from tests.benchmarks.method_rows import failures, methods
from tests.benchmarks.online_rows import online
from tests.benchmarks.optimiser_rows import EVALUATIONS, SEEDS
from tests.benchmarks.optimiser_rows import optimisers as optimiser_rows
from tests.benchmarks.search_rows import ITERATIONS, search
from tests.benchmarks.start_rows import start

PARTS = (
    "start", "others", "c", "jax", "methods", "failures", "gradient", "online", "growth", "loop", "optimisers",
    "exploring", "search",
)  # fmt: skip


def main() -> None:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write all numbers here, after every part")
    parser.add_argument("--rounds", type=int, default=5, help="rounds whose median counts (default 5)")
    parser.add_argument("--quick", action="store_true", help="short logs and a swarm of two iterations")
    parser.add_argument(
        "--iterations", type=int, default=ITERATIONS, help="of the swarm; fewer are a stated part (default 100)"
    )
    parser.add_argument("--only", nargs="*", default=PARTS, choices=PARTS)
    options = parser.parse_args()
    found: dict[str, object] = {}
    for part in options.only:
        began = time.perf_counter()
        print(f"{part} ...", file=sys.stderr, flush=True)
        if part == "search":
            found |= _search(options.quick, options.iterations)
        else:
            found |= _PARTS[part](options.quick, options.rounds)
        print(f"  {part} took {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
        if options.json:
            options.json.write_text(json.dumps(_plain(found), indent=1, allow_nan=False), encoding="utf-8")


def _plain(value: object) -> object:
    """A value as JSON can hold it: null where it is no number."""
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _start(quick: bool, rounds: int) -> dict[str, object]:
    return {"start": show_numbers("first likelihood in a process", start())}


def _others(quick: bool, rounds: int) -> dict[str, object]:
    case = ranger(5.0 if quick else 20.0)
    return {"others": show_numbers("one likelihood, Runge-Kutta with 25 steps", against_others(case, rounds))}


def _c(quick: bool, rounds: int) -> dict[str, object]:
    return {"c": show_numbers("Runge-Kutta steps against C from the same equations", against_c(rounds))}


def _jax(quick: bool, rounds: int) -> dict[str, object]:
    """JAX needs a program of its own for every model; where it is not installed there is nothing to compare with."""
    if importlib.util.find_spec("jax") is None:
        print("\nJAX: skipped, it is not installed", flush=True)
        return {"jax": "skipped: not installed"}
    from tests.benchmarks.jax_steps import against_jax

    return {"jax": show_numbers("Runge-Kutta steps against JAX from the same equations", against_jax(rounds))}


def _methods(quick: bool, rounds: int) -> dict[str, object]:
    found: dict[str, object] = {}
    for name, moderate in (("walk_of_inclination_only", False), ("with_moderate_process_noise", True)):
        case = driveline_drive(15.0 if quick else 40.0, moderate=moderate)
        rows, best = methods(case, rounds)
        found[f"methods_{name}"] = show_rows(f"methods, {name.replace('_', ' ')}", rows)
        found[f"methods_{name}_chosen"] = show_numbers("the method that is chosen", best)
    return found


def _failures(quick: bool, rounds: int) -> dict[str, object]:
    case = driveline_drive(10.0, moderate=False)
    return {"failures": show_rows("failures in the box and its corners", failures(case, 3.0 if quick else 10.0))}


def _gradient(quick: bool, rounds: int) -> dict[str, object]:
    return {"gradient": show_numbers("gradient", gradient(ranger(5.0 if quick else 20.0), rounds))}


def _online(quick: bool, rounds: int) -> dict[str, object]:
    return {"online": show_rows("a stream against a log, one thread", online(ranger(5.0 if quick else 20.0), rounds))}


def _growth(quick: bool, rounds: int) -> dict[str, object]:
    chains = (5, 10) if quick else (5, 10, 20, 50)
    return {
        "growth_states": show_rows("growth with states, chains of masses", growth(chains, rounds)),
        "growth_work": show_rows("growth with samples and members", growth_of_work(ranger(20.0), rounds)),
    }


def _loop(quick: bool, rounds: int) -> dict[str, object]:
    return {"loop": show_numbers("closed loop on the vehicle", loop(60.0 if quick else 300.0))}


def _optimisers(quick: bool, rounds: int) -> dict[str, object]:
    seeds, evaluations = (3, 4_000) if quick else (SEEDS, EVALUATIONS)
    title = f"searches in ten dimensions, medians over {seeds} seeds at {evaluations} evaluations"
    return {"optimisers": show_rows(title, optimiser_rows(seeds, evaluations))}


def _exploring(quick: bool, rounds: int) -> dict[str, object]:
    seeds = 2 if quick else SEEDS
    title = f"explored, then searched by gradients: ten dimensions, medians over {seeds} seeds"
    functions = show_rows(title, exploring_functions(seeds))
    drives = show_rows("explored, then searched by gradients: drives of the vehicle", exploring_drives(seeds // 2))
    return {"exploring_functions": functions, "exploring_drives": drives}


def _search(quick: bool, iterations: int) -> dict[str, object]:
    case = driveline_drive(20.0 if quick else 90.0, moderate=False)
    return {"search": show_numbers("search, two threads", search(case, min(iterations, 2) if quick else iterations))}


_PARTS: dict[str, Callable[[bool, int], dict[str, object]]] = {
    "start": _start, "others": _others, "c": _c, "jax": _jax, "methods": _methods, "failures": _failures,
    "gradient": _gradient, "online": _online, "growth": _growth, "loop": _loop, "optimisers": _optimisers,
    "exploring": _exploring,
}  # fmt: skip


def show_numbers(title: str, numbers: dict[str, float]) -> dict[str, float]:
    """Print one number per line."""
    print(f"\n{title}")
    for name, value in numbers.items():
        print(f"  {name:<52} {value:12.5g}", flush=True)
    return numbers


def show_rows(title: str, rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """Print a table."""
    print(f"\n{title}\n  " + "".join(f"{name:>25}" for name in rows[0]))
    for row in rows:
        print(
            "  " + "".join(f"{v:>25}" if isinstance(v, str | int) else f"{v:>25.4g}" for v in row.values()), flush=True
        )
    return rows


if __name__ == "__main__":
    main()
