"""A cart that is declared without air, and a run of it in air."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import bondgraph as bg

TIME = 0.1 * np.arange(300)


def cart(air: float = 0.0) -> bg.BondGraph:
    """A cart that begins at 3 m/s, of whose air nothing is declared."""
    g = bg.BondGraph("cart")
    force = g.input("force", "N")
    drag = g.parameter("drag", 8.0, "N s/m", "", (2.0, 30.0))
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("push", force, at=body)
    g.inertance("mass", g.parameter("mass", 50.0, "kg", "", (20.0, 100.0)), at=body, state="v", initial=3.0)
    g.resistance("wheels", lambda v: drag * v, at=body)
    if air:
        g.resistance("air", lambda v: air * v * abs(v), at=body)
    g.measure_flow("speed", body)
    return g


def log(first: float) -> bg.MatchedLog:
    """A run in air whose first speed is read wrongly by ``first``."""
    chance = np.random.default_rng(5)
    force = np.repeat(chance.uniform(0.0, 200.0, 12), 25)[np.newaxis]
    y = bg.simulate(bg.build(cart(air=4.0)), TIME, force).y + 0.02 * chance.standard_normal((1, TIME.size))
    y[0, 0] += first
    return bg.MatchedLog("run", TIME, force, y)


def write(folder: Path) -> tuple[Path, Path]:
    """The cart as a graph file, and its run as a table."""
    graph, data, run = folder / "cart.json", folder / "run.csv", log(0.0)
    rows = zip(run.time, run.u[0], run.y[0], strict=True)
    text = "time [s],force [N],speed [m/s]\n" + "".join(f"{t:.2f},{u},{y}\n" for t, u, y in rows)
    data.write_text(text, encoding="utf-8")
    bg.write_graph(cart(), graph)
    return graph, data
