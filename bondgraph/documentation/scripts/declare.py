"""Declare a machine, draw it, and see the equations that follow."""

from sled import sled

import bondgraph as bg

graph = sled()
bg.draw(graph, "sled.svg")  # in a notebook the name alone shows the drawing

model = bg.build(graph)  # causality, equations, units, numpy module
print(repr(model))
print(model.text)
