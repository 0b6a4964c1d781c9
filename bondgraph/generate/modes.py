"""What a generated module says of its modes: discrete values that hold between events.

Only modules of exactly derived graphs have them. ``MODES`` names the held input of each, ``EVENTS`` says what the rows
of ``events(t, x, u, theta)`` are. Of a switch there is one row, its argument, which is positive on the side 1 and
negative on the side -1. Of a friction there are three: its flow, and what it can carry beyond its effort in either
direction. Of an impact there are three: its gap, what it pushes, the speed at which it opens. Who simulates the module
keeps the modes constant between zeros of the rows that end them.
"""

from __future__ import annotations

from bondgraph.derive.equations import Mode, StateEquations
from bondgraph.generate.literals import string
from bondgraph.generate.names import stems


def reset_names(equations: StateEquations) -> list[str]:
    """For each mode the name of the function that gives the states after its impact or lock, empty where none."""
    elements = [mode.element for mode in equations.modes if mode.reset is not None]
    named = stems(elements, "reset_", ("",))
    return [named[mode.element] if mode.reset is not None else "" for mode in equations.modes]


def mode_tables(equations: StateEquations) -> list[str]:
    """``MODES`` and ``EVENTS``, nothing where there are no modes."""
    if not equations.modes:
        return []
    names = zip(reset_names(equations), equations.modes, strict=True)
    modes = [_mode_row(mode, name) for name, mode in names]
    events = [
        f"    ({string(mode.symbol.name)}, {string(function.unit)}, {string(function.meaning)}),"
        for mode in equations.modes
        for function in mode.functions
    ]
    return [
        "# input that holds the mode, kind, element, function of the states after it closes or locks",
        "\n".join(["MODES = (", *modes, ")"]),
        "# mode, unit, meaning of each row of events()",
        "\n".join(["EVENTS = (", *events, ")"]),
    ]


def _mode_row(mode: Mode, reset: str) -> str:
    function = string(reset) if reset else "None"
    return f"    ({string(mode.symbol.name)}, {string(mode.kind)}, {string(mode.element)}, {function}),"
