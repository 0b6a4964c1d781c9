"""Names that other tools and other books give to what a graph declares, for the message that says ours."""

from __future__ import annotations

import re
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


def such_as(name: str) -> str:
    """The end of a message on a name that is none, with one that is: what a bond is called in print has an arrow.

    Examples
    --------
    >>> such_as("air -> room"), such_as("2 x")
    (", such as 'air_room'", '')
    """
    close = "_".join(re.findall(r"[A-Za-z0-9_]+", name))
    return f", such as {close!r}" if close.isidentifier() else ""


def node_hint(name: str, known: Iterable[str]) -> str:
    """The end of a message on a node that is not there: the closest one, or what to write in place of a bond.

    Examples
    --------
    >>> node_hint("air -> room", ["air", "room"])
    ' - that is a bond: name the junction at one of its ends, or a new one that is bonded to both'
    >>> node_hint("rom", ["air", "room"])
    "; did you mean 'room'?"
    """
    if "->" in name or "\u2192" in name:
        return " - that is a bond: name the junction at one of its ends, or a new one that is bonded to both"
    return suggest(name, known)
