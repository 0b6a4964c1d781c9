"""The machine of all pages: a sled on snow that is pushed, and logs of a heavier one that meets wind."""

import numpy as np

import bondgraph as bg


def sled(wind: float = 0.0) -> bg.BondGraph:
    g = bg.BondGraph("sled", doc="A sled on snow, pushed.")
    force = g.input("force", "N", "push")
    mass = g.parameter("mass", 80.0, "kg", "sled with driver", (60.0, 120.0))  # with bounds: may be estimated
    drag = g.parameter("drag", 12.0, "N s/m", "runners on snow", (2.0, 40.0))
    body = g.one_junction("body", bg.TRANSLATION)  # one speed
    g.effort_source("push", force, at=body)
    g.inertance("sled", mass, at=body, state="v")
    g.resistance("runners", lambda v: drag * v, at=body)
    if wind:
        g.resistance("wind", lambda v: wind * v * abs(v), at=body)
    g.measure_flow("speed", body, "speed of the sled")
    return g


def measured(name: str, seed: int, wind: float = 1.5) -> bg.Log:
    """A log of 40 s in place of a measurement: a sled of 95 kg, a sensor with noise of 0.02 m/s."""
    chance = np.random.default_rng(seed)
    time, push = 0.1 * np.arange(400), np.repeat(chance.uniform(0.0, 200.0, 16), 25)
    truth = bg.simulate(bg.build(sled(wind)), time, {"force": push}, theta={"mass": 95.0})
    speed = truth.output("speed") + chance.normal(0.0, 0.02, time.size)
    return bg.Log(
        name, time, {"force": bg.LogChannel("force", "N", push), "speed": bg.LogChannel("speed", "m/s", speed)}
    )
