"""A motor with a winding, a shaft and a gear: three domains in one graph."""

import bondgraph as bg

g = bg.BondGraph("winch", doc="A motor winds up a load.")
voltage = g.input("voltage", "V", "terminals")
L = g.parameter("L", 2.0, "mH", "winding")  # any unit: converted here, shown as declared
R = g.parameter("R", 0.5, "ohm", "winding")
k = g.parameter("k", 0.06, "N m/A", "torque per current")
J = g.parameter("J", 4e-4, "kg m^2", "rotor")
radius = g.parameter("radius", 40.0, "mm", "drum")
mass = g.parameter("mass", 5.0, "kg", "load")
turning = [-200.0, -5.0, 5.0, 200.0]
friction = g.table("friction", turning, [-0.05, -0.02, 0.02, 0.05], "N m", "rad/s", meaning="bearings, measured")

winding = g.one_junction("winding", bg.ELECTRICAL)  # one current
shaft = g.one_junction("shaft", bg.ROTATION)  # one angular speed
rope = g.one_junction("rope", bg.TRANSLATION)  # one speed

g.effort_source("terminals", voltage, at=winding)
g.inertance("L_winding", L, at=winding, state="current")
g.resistance("R_winding", R, at=winding)
g.gyrator("motor", k, winding, shaft)  # torque = k*current, back voltage = k*speed
g.inertance("rotor", J, at=shaft, state="omega")
g.resistance("bearings", friction, at=shaft)
g.transformer("drum", 1 / radius, rope, shaft)
g.inertance("load", mass, at=rope)
g.effort_source("weight", -9.81 * mass, at=rope)
g.integral("height", rope.flow, "m", "of the load")

g.measure_flow("speed", shaft, "shaft", unit="rpm")
g.measure("lifting", 9.81 * mass * rope.flow, "W", "power that lifts")

bg.draw(g, "winch.svg")
model = bg.build(g)
print(repr(model))
run = bg.simulate(model, [0.01 * k for k in range(200)], {"voltage": 24.0})
print(run.summary())
