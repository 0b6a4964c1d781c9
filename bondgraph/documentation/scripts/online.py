"""A stream: states as samples come, and an alarm when the machine changes."""

import numpy as np
from sled import measured, sled

import bondgraph as bg

model = bg.build(sled(wind=1.5))
noise = bg.FilterModel(model, {"v": 0.02}, {"speed": 0.02}, {"v": 0.1})
log = bg.match(measured("run1", 1), model)

online = bg.OnlineFilter(noise, {"mass": 95.0}, interval=0.1, history=0.5, compiled=False)
for t, push, speed in zip(log.time[:50], log.u[0], log.y[0], strict=False):
    step = online.step(t, {"force": push}, {"speed": speed})
print(f"at {online.time:.1f} s: v = {step.mean[0]:.3f} m/s +- {np.sqrt(step.cov[0, 0]):.3f}")

online.state.save("filter.json")  # go on in another process: online.restore(bg.filter.OnlineState.load(...))

detector = bg.ChangeDetector(
    noise, {"icy": {"drag": 4.0}, "loaded": {"mass": 115.0}}, false_alarm_every=3600.0, interval=0.1,
    theta={"mass": 95.0}, compiled=False,
)  # fmt: skip
icy = bg.simulate(model, log.time, {"force": log.u[0]}, theta={"mass": 95.0, "drag": 4.0}).y + 0.02 * (
    np.random.default_rng(7).standard_normal(log.time.size)
)
found = detector.watch(bg.MatchedLog("icy morning", log.time, log.u, icy))
print(found.summary())
found.plot().figure.savefig("alarm.svg")
