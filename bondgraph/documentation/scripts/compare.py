"""The declared model laid over a log: the first thing to do with one."""

from sled import measured, sled

import bondgraph as bg

model, log = bg.build(sled()), measured("run1", 1)
run = bg.simulate(model, inputs=log)
print(run.summary())

compared = bg.compare(model, log)
print(compared.summary())  # compared.to_dataframe() has the same numbers
compared.plot().savefig("compared.svg")
run.save("run.csv")  # a log again; run.to_dataframe(), run.to_xarray()
