"""Angular speeds: rpm, deg/s, turn/s and rad/s, but no bare number per time, which may be turns."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from sympy import pi, tanh

from bondgraph.declare.domains import ROTATION
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.derive.causality import assign_causality
from bondgraph.errors import BondGraphError, DeclarationError, DimensionError

BARE = ("1/min", "1/s", "Hz", "min^-1", "kHz")
ANGULAR = {
    "rpm": math.pi / 30, "rev/min": math.pi / 30, "turn/s": 2 * math.pi, "rev/s": 2 * math.pi,
    "deg/s": math.pi / 180, "rad/s": 1.0, "rad/min": 1 / 60,
}  # fmt: skip


def rotor(declare: Callable[[BondGraph, Handle], object]) -> BondGraph:
    """A rotor to which something is added, with its strokes placed."""
    g = BondGraph("g")
    shaft = g.one_junction("shaft", ROTATION)
    g.inertance("rotor", g.parameter("J", 1.0, "kg m^2"), at=shaft)
    declare(g, shaft)
    assign_causality(g)
    return g


def driven(unit: str, times: object = 1) -> Callable[[BondGraph, Handle], object]:
    """The rotor driven at a given speed through a slipping clutch."""

    def declare(g: BondGraph, shaft: Handle) -> None:
        clutch = g.zero_junction("clutch", ROTATION)
        g.flow_source("drive", times * g.input("n", unit, default=1.0), at=clutch)
        g.bond(clutch, shaft)
        g.resistance("slip", g.parameter("b", 1.0, "N m s"), at=clutch)

    return declare


def friction(unit: str) -> Callable[[BondGraph, Handle], object]:
    """Friction that changes over within a speed."""

    def declare(g: BondGraph, shaft: Handle) -> None:
        level, width = g.parameter("T", 1.0, "N m"), g.parameter("w", 1.0, unit)
        g.resistance("bearing", lambda w: level * tanh(w / width), at=shaft)

    return declare


def slipping(unit: str) -> Callable[[BondGraph, Handle], object]:
    """A brake against a turning ground."""
    return lambda g, shaft: g.resistance(
        "brake", lambda w: g.parameter("b", 1.0, "N m s") * (w - g.parameter("w", 1.0, unit)), at=shaft
    )


def tabulated(unit: str) -> Callable[[BondGraph, Handle], object]:
    """A motor by its table."""
    return lambda g, shaft: g.effort_source(
        "motor", g.table("torque", [0.0, 3000.0], [2.0, 0.0], "N m", unit)(shaft.flow), at=shaft
    )


CASES = {
    "source": driven,
    "source over a gear": lambda unit: driven(unit, 2),
    "width in a law": friction,
    "speed beside a speed": slipping,
    "argument of a table": tabulated,
    "output": lambda unit: lambda g, shaft: g.measure_flow("n", shaft, unit=unit),
    "output as an expression": lambda unit: lambda g, shaft: g.measure("n", 3 * shaft.flow, unit),
    "signal": lambda unit: lambda g, shaft: g.signal("n", shaft.flow, unit),
    "angle of an input": lambda unit: lambda g, shaft: g.integral("angle", g.input("n", unit), "rad"),
}


@pytest.mark.parametrize("unit", BARE)
@pytest.mark.parametrize("case", CASES)
def test_a_bare_number_per_time_is_refused_where_an_angular_speed_is_meant(case, unit):
    with pytest.raises(
        DimensionError, match=r"does not say whether it counts turns or radians - write 'rpm' .*'rad/s'"
    ):
        rotor(CASES[case](unit))


@pytest.mark.parametrize("unit", ANGULAR)
@pytest.mark.parametrize("case", CASES)
def test_units_of_angular_speed_are_taken(case, unit):
    rotor(CASES[case](unit))


@pytest.mark.parametrize("unit", ANGULAR)
def test_units_of_angular_speed_have_their_factor(unit):
    """3000 1/min, once taken for 50 rad/s, are written 3000 rpm: 314."""
    assert rotor(driven(unit)).inputs[0].default == pytest.approx(ANGULAR[unit])


def test_a_frequency_that_is_converted_by_hand_is_taken():
    rotor(driven("Hz", 2 * pi))
    rotor(driven("1/min", 6.283185307179586))
    rotor(lambda g, shaft: g.measure("n", shaft.flow / (2 * pi), "Hz"))
    rotor(lambda g, shaft: g.measure("pulses", g.parameter("pulses_per_radian", 57.3, "1") * shaft.flow, "1/s"))


def test_rates_that_are_no_speeds_stay_per_second():
    def declare(g: BondGraph, shaft: Handle) -> None:
        rate, speed = g.parameter("rate", 6.0, "1/min"), g.input("v", "m/s")
        g.integral("level", lambda x: speed - rate * x, "m")
        inertia = next(p.symbol for p in g.parameters if p.name == "J")
        g.resistance("drag", lambda w: rate * inertia * w, at=shaft)
        g.resistance("oil", g.parameter("b", 1.0, "N m s"), at=shaft)
        g.integral("turns", shaft.flow, "turn")

    g = rotor(declare)
    assert next(p for p in g.parameters if p.name == "rate").value == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("unit", "meant"),
    [
        ("U/min", "rpm"),
        ("Umin", "rpm"),
        ("UPM", "rpm"),
        ("U", "turn"),
        ("RPM", "rpm"),
        ("U/s", "turn/s"),
        ("Grad", "deg"),
        ("Grad/s", "deg/s"),
    ],
)
def test_other_spellings_are_not_taken_for_enzymes_and_gigaradians(unit, meant):
    with pytest.raises(DeclarationError, match=f"unit '{unit}' is not one; did you mean '{meant}'"):
        BondGraph("g").input("n", unit)


def test_the_refusal_names_the_quantity():
    with pytest.raises(BondGraphError, match="g: drive: n is declared in '1/min', but it gives an angular speed"):
        rotor(driven("1/min"))
