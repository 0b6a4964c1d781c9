"""Parameters with intervals from a log, and whether the interval is to be believed."""

from sled import measured, sled

import bondgraph as bg
from bondgraph.estimate import profile_likelihood

model, log = bg.build(sled(wind=1.5)), measured("run1", 1)
fit = bg.estimate(model, [log], free=["mass", "drag"])
print(fit.summary())
fit.plot().savefig("estimate.svg")  # measured, and expected one step ahead

(profile,) = profile_likelihood(fit, "drag")
print(profile)
profile.plot().figure.savefig("profile.svg")

another = measured("run3", 3)
print(bg.sensitivity(model, another, ["mass", "drag"]).summary())  # what another log tells, before it is used
second = bg.estimate(model, another, ["mass", "drag"], priors=[fit.as_prior()])  # what the first said is its prior
print(second.summary())
