"""An effect of one's own in ten lines, found in a log."""

from sled import measured, sled

import bondgraph as bg
from bondgraph.declare import Effect, Place


def air_drag(g: bg.BondGraph, at: Place) -> Effect | None:
    """Drag of the air, which grows with the square of the speed."""
    if at.bond is not None or at.junction.kind != "1" or at.domain != bg.TRANSLATION:
        return None  # no physical sense there
    name = f"air_drag_{at.name}"
    largest = 2.0 * at.scale.effort / at.scale.flow**2  # scales the search, does not bound it
    c = g.parameter(f"c_{name}", 0.0, "N/(m/s)^2", "half density times drag area", (0.0, largest))
    g.resistance(name, lambda v: c * v * abs(v), at=at.junction)
    return Effect("air_drag", name, "effort = c*flow*|flow|", (c.name,), dissipative=True)


if __name__ == "__main__":
    found = bg.close_loop(sled(), [measured("run1", 1)], [measured("run2", 2)], effects=[air_drag])
    print(found.summary())
