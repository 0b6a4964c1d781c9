"""Time from a declared graph to a generated module: a chain of N mass-spring-damper stages.

    python -m tests.benchmarks.bench_derivation [N ...] [--peers [N ...]] [--json FILE]

Prints one row per N with the processor seconds of each stage, and the growth from N = 100 on. The bound is 1 s for
N = 100 (200 states, 600 bonds), from declaration to text, after imports, and growth no worse than N^1.3. ``--peers``
installs other tools into temporary environments and adds the time they take to the state equations of the same chain
(BondGraphTools, ``bondgraph`` of PyPI, Kane's method of sympy), each size in a process that is stopped after two
minutes, and the ratio to ours.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.benchmarks.derivation_peers import PEERS, peer_seconds

STAGES = ("declare", "causality", "derive", "dimensions", "render")


def chain(stages: int) -> Any:
    """N masses in a row, each joined to the next by a spring with a damper beside it, pushed at one end."""
    from bondgraph.declare.domains import TRANSLATION
    from bondgraph.declare.graph import BondGraph

    g = BondGraph("chain", doc="masses joined by springs and dampers")
    push = g.input("push", "N", "force at the free end")
    before = None
    for i in range(stages):
        m = g.parameter(f"m_{i}", 1.0 + i, "kg")
        k = g.parameter(f"k_{i}", 100.0, "N/m")
        d = g.parameter(f"d_{i}", 1.0, "N s/m")
        body = g.one_junction(f"body_{i}", TRANSLATION)
        g.inertance(f"mass_{i}", m, at=body)
        joint = g.zero_junction(f"joint_{i}", TRANSLATION)
        stretch = g.one_junction(f"stretch_{i}", TRANSLATION)
        g.bond(joint, stretch)
        if before is None:
            g.bond(body, joint)
        else:
            g.bond(before, joint)
            g.bond(joint, body)
        g.compliance(f"spring_{i}", k, at=stretch)
        g.resistance(f"damper_{i}", lambda v, d=d: d * v, at=stretch)
        before = body
    g.effort_source("pusher", push, at=before)
    return g


def stage_seconds(stages: int) -> dict[str, float]:
    """Seconds of each stage for one chain."""
    from bondgraph.derive.causality import assign_causality
    from bondgraph.derive.derivation import derive
    from bondgraph.derive.dimensions import check_dimensions
    from bondgraph.generate.module import render

    seconds: dict[str, float] = {}

    gc.collect()  # what earlier chains left behind is not ours to clear away

    def timed(stage: str, action: Callable[[], Any]) -> Any:
        start = time.process_time()
        result = action()
        seconds[stage] = time.process_time() - start
        return result

    graph = timed("declare", lambda: chain(stages))
    causal = timed("causality", lambda: assign_causality(graph))
    equations = timed("derive", lambda: derive(causal))
    timed("dimensions", lambda: check_dimensions(equations))
    timed("render", lambda: render(equations))
    return seconds


def growth(sizes: list[int], seconds: list[float]) -> float:
    """Exponent of the power of N that fits best."""
    x = [math.log(size) for size in sizes]
    y = [math.log(value) for value in seconds]
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / sum((a - mean_x) ** 2 for a in x)


def table(sizes: list[int]) -> dict[int, dict[str, float]]:
    """Print one row per size; the seconds of each stage and in all."""
    titles = " ".join(f"{stage:>10}" for stage in STAGES)
    print(f"{'N':>5} {'states':>7} {'bonds':>6} {titles} {'total':>8}  [s]")
    found = {}
    for size in sizes:
        seconds = stage_seconds(size)
        found[size] = seconds | {"total": sum(seconds.values())}
        cells = " ".join(f"{seconds[stage]:10.3f}" for stage in STAGES)
        print(f"{size:5d} {2 * size:7d} {6 * size:6d} {cells} {found[size]['total']:8.3f}", flush=True)
    return found


def peer_table(sizes: list[int]) -> dict[str, dict[str, float | str]]:
    """Print what each peer takes; the seconds, and their ratio to ours for the same chain up to printed text."""
    found: dict[str, dict[str, float | str]] = {}
    for name, peer in PEERS.items():
        found[name] = {}
        for size, answer in peer_seconds(peer, sizes).items():
            found[name][f"seconds_{size}"] = answer
            text = answer
            if isinstance(answer, float):
                ratio = answer / sum(stage_seconds(size).values())
                found[name][f"ratio_{size}"] = round(ratio, 1)
                text = f"{answer:.2f} s, {ratio:.0f} times ours"
            print(f"{name:>18} N = {size:3d}: {text}", flush=True)
    return found


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", nargs="*", type=int, default=[25, 50, 100, 200, 400])
    parser.add_argument("--peers", nargs="*", type=int, metavar="N", help="also time other tools (5 10 20 50)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers")
    options = parser.parse_args()
    stage_seconds(3)  # imports and caches
    rows = table(options.sizes)
    answer: dict[str, Any] = {"seconds": {str(size): row for size, row in rows.items()}}
    large = [size for size in options.sizes if size >= 100]
    if len(large) > 1:
        answer["growth_exponent"] = round(growth(large, [rows[size]["total"] for size in large]), 3)
        print(f"growth from {large[0]} to {large[-1]}: N^{answer['growth_exponent']:.2f}")
    if options.peers is not None:
        answer["peers"] = peer_table(options.peers or [5, 10, 20, 50])
    if options.json:
        options.json.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
