"""What the declaration lacks, found in one log and judged by another."""

from pathlib import Path

from sled import measured, sled

import bondgraph as bg

train, held_out = measured("run1", 1), measured("run2", 2)
loop = bg.close_loop(sled(), [train], [held_out])
print(loop.summary())
Path("lines.py").write_text(loop.python_lines())

loop.plot().figure.savefig("before_after.svg")
new = [added.trial.candidate.effect.element for added in loop.added]
bg.draw(loop.graph, "corrected.svg", highlight=new)
loop.report("loop")  # loop/report.html, result.json, graph, module, patch
