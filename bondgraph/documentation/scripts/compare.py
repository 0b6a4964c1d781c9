"""The declared model laid over a log: the first thing to do with one."""

from sled import measured, sled

import bondgraph as bg
from bondgraph.report.comparison import compare_logs, comparison_figure, comparison_text

model, log = bg.build(sled()), measured("run1", 1)
run = bg.simulate(model, inputs=log)
print(run.summary())

compared = compare_logs(model, [bg.match(log, model)])
print(comparison_text(compared))
comparison_figure(compared.runs[0]).savefig("compared.svg")
run.save("run.csv")  # a log again; run.to_dataframe(), run.to_xarray()
