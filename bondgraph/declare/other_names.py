"""Names that other tools and other books give to what a graph declares, for the message that says ours."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NoReturn

from bondgraph.errors import suggest

#: Names of what is declared here -> those in other tools.
_OTHERS = {
    "compliance(name, displacement=C)": ("capacitance", "capacitor", "capacity", "accumulator", "C"),
    "compliance(name, stiffness)": ("spring",),
    "resistance(name, flow=G)": ("conductance",),
    "inertance": ("inductance", "inductor", "inertia", "mass", "I", "L"),
    "resistance": ("resistor", "damper", "damping", "R"),
    "effort_source": ("voltage_source", "force_source", "torque_source", "pressure_source", "temperature_source", "Se"),
    "flow_source": ("current_source", "velocity_source", "speed_source", "heat_source", "Sf"),
    "zero_junction (one effort) or one_junction (one flow)": ("junction", "node"),
    "bond": ("connect", "add_bond", "edge", "link"),
    "transformer": ("gear", "lever", "piston", "TF"),
    "gyrator": ("motor", "GY"),
    "parameter": ("constant", "param"),
    "measure_effort, measure_flow or measure": ("output", "sensor", "measurement"),
    "integral": ("state", "integrator"),
}  # fmt: skip
_OURS = {other.lower(): ours for ours, others in _OTHERS.items() for other in others}


def refuse_name(name: str, known: Iterable[str]) -> NoReturn:
    """The refusal of a name that a graph does not have.

    Raises
    ------
    AttributeError
        Always, with the name that is meant where it is known or close.

    Examples
    --------
    >>> refuse_name("inductor", [])
    Traceback (most recent call last):
    ...
    AttributeError: a BondGraph has no 'inductor'; it is called inertance here
    """
    ours = _OURS.get(name.lower(), _OURS.get(name.lower().removeprefix("add_"), ""))
    hint = f"; it is called {ours} here" if ours else suggest(name, known)
    raise AttributeError(f"a BondGraph has no {name!r}{hint}")
