"""Logs as loggers write them: other separators, decimal commas, other units, gaps."""

from pathlib import Path

from sled import sled

import bondgraph as bg

Path("logger.csv").write_text(
    "stamp;push;v;gear\nms;kN;km/h;text\n0,0;0,10;0,0;H\n100,0;0,10;0,4;H\n200,0;0,12;;H\n300,0;0,12;1,3;L\n"
)
log = bg.read_log("logger.csv", time="stamp")  # units stand in the second row here; units={"v": "km/h"} says others
print(repr(log))
print(bg.inspect(log).summary())

matched = bg.match(log, bg.build(sled()), {"push": "force", "v": "speed"})  # columns of the log -> names in the model
print(matched.u[0], "N")
print(matched.y[0].round(3), "m/s; nan where nothing was measured")
