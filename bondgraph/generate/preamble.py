"""Head of a generated module: docstring, import, and the tables of states, inputs, parameters and outputs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bondgraph.declare.quantities import Input, ParameterStart, Start
from bondgraph.derive.equations import StateEquations
from bondgraph.generate.literals import number, one_line, string

#: Names this form of generated modules; who loads one looks at it first.
FORMAT = "bondgraph-module/1"


def preamble(equations: StateEquations) -> str:
    """All that stands before the functions."""
    return "\n".join(
        [
            _docstring(equations),
            "import numpy as np",
            "",
            f"NAME = {string(equations.name)}",
            f"FORMAT = {string(FORMAT)}",
            "# name, unit, initial value, meaning",
            _table("STATES", _state_rows(equations)),
            '# name, unit, default, between samples ("linear" or "hold"), letters of a text signal, meaning',
            _table("INPUTS", _input_rows(equations)),
            *_zero_defaults(equations),
            "# name, unit, value, lower and upper bound (None: known, stays fixed), meaning",
            _table("PARAMETERS", _parameter_rows(equations)),
            *_tolerances(equations),
            "# name, unit, meaning",
            _table("OUTPUTS", _output_rows(equations)),
            *_starts(equations),
            *_parameter_starts(equations),
            *_shown_units(equations),
        ]
    )


def _starts(equations: StateEquations) -> list[str]:
    """The states that start at a signal of a log; nothing where none does."""
    begun = [(state.symbol.name, state.start) for state in equations.states if isinstance(state.start, Start)]
    rows = [(string(name), string(one.signal), number(one.factor, f"start of {name}")) for name, one in begun]
    comment = "# state, input or output at whose first value in a log it starts, factor"
    return [comment, _table("STARTS", rows)] if rows else []


def _parameter_starts(equations: StateEquations) -> list[str]:
    """The states that start where parameters say; nothing where none does."""
    names = [string(one.symbol.name) for one in equations.states if isinstance(one.start, ParameterStart)]
    comment = "# states that start where parameters say, see start; above is where that is at the declared values"
    return [comment, f"PARAMETER_STARTS = ({', '.join(names)}{',' * (len(names) == 1)})"] if names else []


def _shown_units(equations: StateEquations) -> list[str]:
    """The declared units of quantities that were not declared in coherent SI; nothing where all were."""
    states, outputs = (
        [(one.symbol.name, one.shown_unit) for one in of] for of in (equations.states, equations.outputs)
    )
    inputs, parameters = ([(one.name, one.shown_unit) for one in of] for of in (equations.inputs, equations.parameters))
    listed = {"STATES": states, "INPUTS": inputs, "PARAMETERS": parameters, "OUTPUTS": outputs}
    rows = [(string(of), string(name), string(unit)) for of, pairs in listed.items() for name, unit in pairs if unit]
    comment = "# of, name, unit in which numbers are shown and read (all numbers here are in the units above)"
    return [comment, _table("SHOWN_UNITS", rows)] if rows else []


def _docstring(equations: StateEquations) -> str:
    summary = one_line(equations.doc.strip().partition("\n")[0]) or f"{one_line(equations.name)}."
    sections = {
        "States x": [(state.symbol.name, state.unit, state.meaning) for state in equations.states],
        "Inputs u": [(item.name, item.unit, item.meaning) for item in equations.inputs],
        "Parameters theta": [(item.name, item.unit, item.meaning) for item in equations.parameters],
        "Outputs y": [(item.symbol.name, item.unit, item.meaning) for item in equations.outputs],
    }
    lines = [f'"""{summary}']
    for title, rows in sections.items():
        if rows:
            lines += ["", f"{title}:", *_listed(rows)]
    return "\n".join([*lines, '"""'])


def _listed(rows: Sequence[tuple[str, str, str]]) -> Iterable[str]:
    width = max(len(name) for name, _, _ in rows)
    for index, (name, unit, meaning) in enumerate(rows):
        yield f"    {index:3d}  {name:{width}}  [{one_line(unit) or '?'}]  {one_line(meaning)}".rstrip()


def _table(name: str, rows: Iterable[Sequence[str]]) -> str:
    lines = [f"    ({', '.join(row)})," for row in rows]
    return "\n".join([f"{name} = (", *lines, ")"]) if lines else f"{name} = ()"


def _state_rows(equations: StateEquations) -> Iterable[Sequence[str]]:
    for state in equations.states:
        name = state.symbol.name
        yield string(name), string(state.unit), number(state.initial, f"initial value of {name}"), string(state.meaning)


def _input_rows(equations: StateEquations) -> Iterable[Sequence[str]]:
    for item in equations.inputs:
        letters = [f"{string(letter)}: {number(value, f'letter {letter}')}" for letter, value in item.letters]
        yield (
            string(item.name),
            string(item.unit),
            number(item.default, f"default of {item.name}"),
            string(_way(item)),
            f"{{{', '.join(letters)}}}" if letters else "None",
            string(item.meaning),
        )


def _way(item: Input) -> str:
    """How an input runs between samples, or which other one it follows."""
    if item.late_of and not item.rate_of:
        return f"{item.late_by!r} s after {item.late_of}"
    return f"rate of {item.rate_of}" if item.rate_of else item.interpolation


def _zero_defaults(equations: StateEquations) -> Iterable[str]:
    """The inputs whose default of zero is declared; what they do not name, and what is zero above, has none."""
    names = [string(item.name) for item in equations.inputs if item.zero_default]
    if names:
        yield "# inputs that are zero where a log lacks them; the others with a default of 0.0 must be given"
        yield f"ZERO_DEFAULTS = ({', '.join(names)}{',' * (len(names) == 1)})"


def _parameter_rows(equations: StateEquations) -> Iterable[Sequence[str]]:
    for item in equations.parameters:
        lower, upper = item.bounds or (None, None)
        yield (
            string(item.name),
            string(item.unit),
            number(item.value, f"value of {item.name}"),
            number(lower, f"lower bound of {item.name}"),
            number(upper, f"upper bound of {item.name}"),
            string(item.meaning),
        )


def _tolerances(equations: StateEquations) -> list[str]:
    """The shares by which known parameters may be off; nothing where none are declared."""
    known = [(item.name, item.tolerance) for item in equations.parameters if item.tolerance is not None]
    rows = [(string(name), number(share, f"tolerance of {name}")) for name, share in known]
    comment = "# parameter, share of its value by which it may be off (two standard deviations; 0: exact)"
    return [comment, _table("TOLERANCES", rows)] if rows else []


def _output_rows(equations: StateEquations) -> Iterable[Sequence[str]]:
    return [(string(item.symbol.name), string(item.unit), string(item.meaning)) for item in equations.outputs]
