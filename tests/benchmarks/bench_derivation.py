"""Time from a declared graph to a generated module: a chain of N mass-spring-damper stages.

    python tests/benchmarks/bench_derivation.py [--peers] [N ...]

Prints one row per N with the processor seconds of each stage and the growth between rows. The bound is 1 s for N = 100
(200 states, 600 bonds), from declaration to text, after imports, and growth no worse than N^1.3. ``--peers`` adds the
time that other installed tools take to derive the state equations of the same chain (BondGraphTools; Kane's method of
sympy), each in a process of its own that is stopped after two minutes.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

STAGES = ("declare", "causality", "derive", "dimensions", "render")
PEER_LIMIT = 120.0


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


PEERS = {
    "BondGraphTools": """
import BondGraphTools as bgt, time, sys
n = int(sys.argv[1]); start = time.perf_counter()
model = bgt.new(name="chain"); before = None
for i in range(n):
    body, joint, stretch = bgt.new("1", name=f"b{i}"), bgt.new("0", name=f"j{i}"), bgt.new("1", name=f"s{i}")
    mass, spring = bgt.new("I", name=f"m{i}", value=1.0 + i), bgt.new("C", name=f"k{i}", value=0.01)
    damper = bgt.new("R", name=f"d{i}", value=1.0)
    bgt.add(model, body, joint, stretch, mass, spring, damper)
    bgt.connect(body, mass); bgt.connect(joint, stretch); bgt.connect(stretch, spring); bgt.connect(stretch, damper)
    if before is None:
        bgt.connect(body, joint)
    else:
        bgt.connect(before, joint); bgt.connect(joint, body)
    before = body
model.constitutive_relations
print(time.perf_counter() - start)
""",
    "sympy": """
import sys, time
from sympy import symbols
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, dynamicsymbols
n = int(sys.argv[1]); start = time.perf_counter()
frame = ReferenceFrame("N"); origin = Point("O"); origin.set_vel(frame, 0)
q, u = dynamicsymbols(f"q:{n}"), dynamicsymbols(f"u:{n}")
m, k, d = symbols(f"m:{n}"), symbols(f"k:{n}"), symbols(f"d:{n}")
points, bodies, loads = [], [], []
for i in range(n):
    point = origin.locatenew(f"P{i}", q[i] * frame.x); point.set_vel(frame, u[i] * frame.x)
    below = (q[i - 1], u[i - 1]) if i else (0, 0)
    force = -k[i] * (q[i] - below[0]) - d[i] * (u[i] - below[1])
    if i + 1 < n:
        force += k[i + 1] * (q[i + 1] - q[i]) + d[i + 1] * (u[i + 1] - u[i])
    bodies.append(Particle(f"M{i}", point, m[i])); loads.append((point, force * frame.x))
kane = KanesMethod(frame, q, u, kd_eqs=[a.diff() - b for a, b in zip(q, u)])
kane.kanes_equations(bodies, loads); kane.rhs()
print(time.perf_counter() - start)
""",
}


def peer_seconds(peer: str, stages: int) -> str:
    """Seconds a peer takes, or why there are none."""
    if importlib.util.find_spec(peer) is None:
        return "not installed"
    command = [sys.executable, "-W", "ignore", "-c", PEERS[peer], str(stages)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PEER_LIMIT, check=False)
    except subprocess.TimeoutExpired:
        return f"> {PEER_LIMIT:.0f}"
    if done.returncode:
        return "fails: " + (done.stderr.strip().splitlines() or ["?"])[-1][:60]
    return f"{float(done.stdout.split()[-1]):.2f}"


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", nargs="*", type=int, default=[25, 50, 100, 200, 400])
    parser.add_argument("--peers", action="store_true", help="also time other installed tools")
    options = parser.parse_args()
    stage_seconds(3)  # imports and caches
    titles = " ".join(f"{stage:>10}" for stage in STAGES)
    print(f"{'N':>5} {'states':>7} {'bonds':>6} {titles} {'total':>8}  [s]")
    totals = []
    for size in options.sizes:
        seconds = stage_seconds(size)
        totals.append(sum(seconds.values()))
        cells = " ".join(f"{seconds[stage]:10.3f}" for stage in STAGES)
        print(f"{size:5d} {2 * size:7d} {6 * size:6d} {cells} {totals[-1]:8.3f}")
    if len(totals) > 1:
        print(f"growth: N^{growth(options.sizes, totals):.2f}")
    if options.peers:
        for peer in PEERS:
            for size in (5, 10, 25, 50):
                text = peer_seconds(peer, size)
                print(f"{peer:>16} N = {size:3d}: {text}{' s' * text[0].isdigit()}")
                if not text[0].isdigit():
                    break


if __name__ == "__main__":
    main()
