"""State equations to print: a small machine with every kind of line, and a way to load what was printed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy

from bondgraph.declare.functions import table_function
from bondgraph.declare.quantities import Input, Parameter, Table, symbol
from bondgraph.derive.equations import Assignment, ImplicitLoop, OutputEquation, State, StateEquations


def belt_drive() -> StateEquations:
    """An engine with a torque table drives a vehicle through a belt that slips."""
    omega, v, tau_in, gear = map(symbol, ("omega", "v", "tau_in", "gear"))
    mass, inertia, radius, grip, drag = map(symbol, ("m", "J", "r", "grip", "lambda"))
    slip, force, drag_force, unused = map(symbol, ("slip", "F_belt", "F_drag", "unused"))
    torque, losses = table_function("torque"), table_function("losses", 2)
    belt = ImplicitLoop(
        name="belt",
        unknowns=(force,),
        guesses=(sympy.S.Zero,),
        residuals=(force - grip * sympy.tanh(slip / sympy.Float(0.05)),),
        units=("N",),
        body=(Assignment(slip, radius * omega - v - force / 4000, "m/s", "speed lost in the belt"),),
        meaning="force the belt carries",
    )
    return StateEquations(
        name="machine",
        doc="Belt drive: torque table, slipping belt, drag.\n\nMore text.",
        source="vehicle_graphs/machine.py",
        states=(
            State(omega, "rad/s", 100.0, "speed of the engine", "engine_inertia", "flow"),
            State(v, "m/s", 0.0, "speed of the vehicle", "body", "flow"),
        ),
        inputs=(
            Input("tau_in", "N m", "torque of a starter"),
            Input("gear", "1", "ratio", 10.0, "hold", (("H", 10.0), ("L", 22.0))),
        ),
        parameters=(
            Parameter("m", 260.0, "kg", "vehicle with driver"),
            Parameter("J", 0.02, "kg m^2", "engine", (0.01, 0.05)),
            Parameter("r", 0.1, "m"),
            Parameter("grip", 900.0, "N", "force at which the belt slips", (300.0, 2000.0)),
            Parameter("lambda", 0.4, "kg/m", "drag"),
        ),
        tables=(
            Table("torque", (50.0, 150.0, 300.0, 400.0), (18.0, 25.0, 20.0, 0.0), unit="N m", meaning="full throttle"),
            Table("losses", (0.0, 10.0, 30.0), ((0.0, 1.0), (2.0, 5.0), (4.0, 11.0)), (100.0, 400.0), unit="N m"),
            Table("spare", (0.0, 1.0), (0.0, 1.0)),
        ),
        assignments=(
            Assignment(drag_force, drag * v * sympy.Abs(v), "N", "effort of aero"),
            Assignment(unused, v / mass, "m/(s kg)", "nothing uses it"),
            belt,
        ),
        derivatives=(
            (tau_in + torque(omega) - losses(v, omega) - radius * force) / inertia,
            (force - drag_force) / mass,
        ),
        outputs=(
            OutputEquation(symbol("engine_speed"), omega, "rad/s", "at the crankshaft"),
            OutputEquation(symbol("slip_speed"), slip * gear, "m/s", "as the gauge shows it"),
        ),
    )


@pytest.fixture(scope="session")
def machine() -> StateEquations:
    return belt_drive()


@pytest.fixture(scope="session")
def equations() -> Callable[..., StateEquations]:
    """Equations of one state, one parameter and nothing else, with the fields given by name."""

    def build(**changes: Any) -> StateEquations:
        a, k = symbol("a"), symbol("k")
        smallest = StateEquations(
            name="small",
            doc="",
            source="small.json",
            states=(State(a, "1", 0.0, "", "store", "flow"),),
            inputs=(),
            parameters=(Parameter("k", 2.0, "1"),),
            tables=(),
            assignments=(),
            derivatives=(-k * a,),
            outputs=(),
        )
        return dataclasses.replace(smallest, **changes)

    return build


@pytest.fixture(scope="session")
def load() -> Callable[[str], SimpleNamespace]:
    """Run printed text; floating-point warnings of branches not taken are not errors."""

    def run(text: str) -> SimpleNamespace:
        namespace: dict[str, Any] = {}
        exec(compile(text, "generated", "exec"), namespace)
        quiet = np.errstate(all="ignore")
        return SimpleNamespace(**{n: quiet(f) if callable(f) else f for n, f in namespace.items() if n != "np"})

    return run
