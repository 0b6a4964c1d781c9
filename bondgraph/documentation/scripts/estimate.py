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

later = bg.pose(fit.problem.filter_model, bg.match(measured("run3", 3), model), ["mass", "drag"])
print(bg.sensitivity(later).summary())  # what another log would tell, before it is used
