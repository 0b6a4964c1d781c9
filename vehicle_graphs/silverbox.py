"""Silverbox: an electronic circuit that behaves like a mass on a spring with a damper.

``start`` is the linear machine: the voltage V1 drives a mass on a spring with a damper, V2 shows the displacement. One
volt of V1 counts as one newton, one volt of V2 as one metre, so that forces and displacements are read in volts. The
circuit was made with a spring that hardens; that law is left for the closed loop to find.

Source: T. Wigren, J. Schoukens (2013), *Three free data sets for development and benchmarking in nonlinear system
identification*, European Control Conference. The generator drove the circuit through a reconstruction filter, so the
force is band limited between its samples.
"""

from __future__ import annotations

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Interpolation


def start(between: Interpolation = "band limited") -> BondGraph:
    """A mass, a linear spring and a viscous damper, with the zero of the drive.

    Parameters
    ----------
    between
        How the force runs between its samples.

    Examples
    --------
    >>> [parameter.name for parameter in start().parameters if parameter.bounds]
    ['mass', 'damping', 'stiffness', 'force_zero']
    """
    g = BondGraph("silverbox", doc=__doc__, source="vehicle_graphs/silverbox.py")
    force = g.input("force", "N", "V1, behind the generator's reconstruction filter", between=between)

    mass = g.parameter("mass", 5e-6, "kg", "mass of the analogue", (1e-6, 2e-5))
    damping = g.parameter("damping", 2e-4, "N s/m", "damper of the analogue", (0.0, 2e-3))
    stiffness = g.parameter("stiffness", 1.0, "N/m", "spring of the analogue", (0.2, 5.0))
    zero = g.parameter("force_zero", 0.0, "N", "what the circuit adds to the drive", (-0.02, 0.02))

    body = g.one_junction("body", TRANSLATION)
    g.effort_source("drive", force + zero, at=body)
    g.inertance("moving_mass", mass, at=body, state="v_body")
    g.compliance("spring", lambda x: stiffness * x, at=body, state="x_body")
    g.resistance("damper", damping, at=body)
    g.measure_displacement("displacement", "spring", "V2", "m")
    return g


def linear_between() -> BondGraph:
    """The same with the force straight between its samples.

    Examples
    --------
    >>> linear_between().inputs[0].interpolation
    'linear'
    """
    return start("linear")
