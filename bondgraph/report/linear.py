"""A declared graph near an operating point: matrices, modes, transfer functions and Bode diagrams."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from sympy import QQ, Expr

from bondgraph.coherent import Displayed
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.equations import StateEquations
from bondgraph.derive.linearisation import (
    Equilibrium,
    LinearModel,
    equilibrium,
    linearise,
    mode_table,
    modes,
)
from bondgraph.derive.response import Margins, frequency_response, margins, telling_frequencies
from bondgraph.derive.transfer import LAPLACE_S, poles_zeros, transfer_function
from bondgraph.errors import DerivationError, OptionError, suggest
from bondgraph.report.diagram.text import plain
from bondgraph.report.figures import AFTER, BEFORE, figure_style
from bondgraph.report.numbers import shown

#: Transfer functions with more states between input and output than this are given in numbers only.
_IN_SYMBOLS = 6
#: Ground of a remark that may lie over a curve.
_OVER_CURVES = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
#: Matrices of models with more states than this are not printed as text.
_ON_A_PAGE = 14


@dataclass(frozen=True)
class LinearAnswer:
    """A linear model, the equilibrium it was taken at (if one was looked for), and the equations it came from."""

    equations: StateEquations
    model: LinearModel
    steady: Equilibrium | None
    parameters: Mapping[str, float]


def linear_answer(
    graph: BondGraph, at: Mapping[str, float], steady: bool = False, moving: Sequence[str] = ()
) -> LinearAnswer:
    """Linearise a graph.

    Parameters
    ----------
    graph
        The declared graph.
    at
        Values of states, inputs and parameters by name, in their declared units; the rest are initial and default
        values.
    steady
        Look for an equilibrium first, from these states.
    moving
        States that may go on moving in that equilibrium (a distance).

    Raises
    ------
    OptionError
        If a name is unknown.
    DerivationError
        If there is no equilibrium near the point.
    """
    equations = derive(assign_causality(graph))
    check_closed(equations)
    groups: dict[str, dict[str, Displayed]] = {
        "state": {state.symbol.name: state for state in equations.states},
        "input": {given.name: given for given in equations.inputs},
        "parameter": {given.name: given for given in equations.parameters},
    }
    every = [name for names in groups.values() for name in names]
    for name in at:
        if name not in every:
            raise OptionError(
                f"--at {name}: no state, input or parameter of {graph.name}{suggest(name, every)} - there are "
                f"{', '.join(every)}",
                where=("--at", name),
            )
    x, u, theta = (
        {name: one.coherent(at[name]) for name, one in group.items() if name in at} for group in groups.values()
    )
    found = equilibrium(equations, u, theta, x, moving) if steady else None
    if found is not None and not found.found:
        raise DerivationError(f"{graph.name}: {found.outcome.value}", where=(graph.name,))
    model = linearise(equations, x if found is None else found.x, u, theta)
    values = {given.name: given.value for given in equations.parameters} | theta
    return LinearAnswer(equations, model, found, values)


def linear_json(answer: LinearAnswer) -> dict[str, Any]:
    """The answer as one JSON object, in coherent SI: names, operating point, matrices (rows of numbers), modes."""
    model = answer.model
    return {
        "name": answer.equations.name,
        "states": list(model.states),
        "inputs": list(model.inputs),
        "outputs": list(model.outputs),
        "x": dict(zip(model.states, model.x.tolist(), strict=True)),
        "u": dict(zip(model.inputs, model.u.tolist(), strict=True)),
        "rates": dict(zip(model.states, model.rates.tolist(), strict=True)),
        "A": model.A.tolist(),
        "B": model.B.tolist(),
        "C": model.C.tolist(),
        "D": model.D.tolist(),
        "modes": [
            {
                "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                "natural_frequency": mode.natural_frequency,
                "damping": mode.damping,
                "time_constant": mode.time_constant,
                "state": mode.state,
            }
            for mode in modes(model)
        ],
    }


def linear_text(answer: LinearAnswer) -> str:
    """The answer for reading: operating point in declared units, modes, and the matrices (coherent SI) with names."""
    model = answer.model
    first_line = answer.equations.doc.strip().partition("\n")[0]
    lines = [f"{answer.equations.name}: {first_line}".removesuffix(": "), ""]
    if answer.steady is not None:
        lines += [f"equilibrium: {answer.steady.outcome.value}", ""]
    lines.append("operating point")
    for name, one, x, rate in zip(model.states, answer.equations.states, model.x, model.rates, strict=True):
        lines.append(f"  {name:24} {one.shown(x):>12.6g} {one.display_unit:10} rate {one.shown(rate):.4g}")
    for name, given, u in zip(model.inputs, answer.equations.inputs, model.u, strict=True):
        lines.append(f"  {name:24} {given.shown(u):>12.6g} {given.display_unit:10} input")
    lines += ["", mode_table(modes(model))]
    if len(model.states) > _ON_A_PAGE:
        return "\n".join([*lines, "", f"matrices of {len(model.states)} states do not fit here: use --json"])
    for letter, matrix, rows, columns in (
        ("A", model.A, model.states, model.states),
        ("B", model.B, model.states, model.inputs),
        ("C", model.C, model.outputs, model.states),
        ("D", model.D, model.outputs, model.inputs),
    ):
        if matrix.size:
            lines += ["", *_matrix(letter, matrix, rows, columns)]
    return "\n".join(lines)


def _matrix(letter: str, matrix: np.ndarray[Any, Any], rows: Sequence[str], columns: Sequence[str]) -> list[str]:
    width = max(11, *(len(name) + 2 for name in columns))
    label = max(len(name) for name in rows)
    lines = [letter + " " * (label + 1) + "".join(f"{name:>{width}}" for name in columns)]
    return lines + [
        f"  {name:{label}}" + "".join(f"{value:>{width}.4g}" for value in values)
        for name, values in zip(rows, matrix, strict=True)
    ]


def transfer_text(answer: LinearAnswer, given: str, measured: str) -> str:
    """Transfer function from an input to an output, in symbols where the graph is linear and small; poles and zeros."""
    numeric = transfer_function(answer.model, given, measured)
    lines = [f"{measured}(s)/{given}(s)"]
    if len(answer.model.states) <= _IN_SYMBOLS:
        try:
            lines.append(f"  = {transfer_function(answer.equations, given, measured)}")
        except DerivationError:
            lines.append("  at this operating point (the graph is not linear between them)")
    found = poles_zeros(numeric)
    lines.append(f"  = {_normalised(numeric)}")
    lines.append(f"  poles [1/s]: {_list_of(found.poles)}")
    lines.append(f"  zeros [1/s]: {_list_of(found.zeros)}")
    return "\n".join(lines)


def _normalised(transfer: Expr) -> Expr:
    """The same ratio with a denominator that begins with one, in six digits."""
    above, below = (sympy.Poly(part, LAPLACE_S, domain=QQ) for part in sympy.fraction(transfer))
    leading = below.LC()
    return (above.mul_ground(1 / leading).as_expr() / below.mul_ground(1 / leading).as_expr()).evalf(6)


def _list_of(values: np.ndarray[Any, Any]) -> str:
    shown = [f"{value.real:.5g}{value.imag:+.5g}j" if value.imag else f"{value.real:.5g}" for value in values]
    return ", ".join(shown) or "none"


def bode_figure(answer: LinearAnswer, pairs: Sequence[tuple[str, str]]) -> Figure:
    """Magnitude in decibels and phase against frequency, a column for each pair of input and output.

    0 dB is one coherent unit of the output per unit of the input. Above stands the operating point; the margins are
    those of the output fed back to the input with a factor of one.
    """
    model = answer.model
    places = [(_index(model.outputs, y, "output"), _index(model.inputs, u, "input")) for u, y in pairs]
    found = [margins(model, row, at) for row, at in places]
    frequencies = _holding(telling_frequencies(model), found)
    response = frequency_response(model, frequencies)
    with figure_style():
        figure = Figure(figsize=(max(5.0, 4.2 * len(pairs)), 5.6), layout="constrained")
        panels = figure.subplots(2, len(pairs), sharex="col", squeeze=False)
        for (above, below), (given, measured), (row, at), own in zip(panels.T, pairs, places, found, strict=True):
            unit = f"{model.units.outputs[row] or '1'} per {model.units.inputs[at] or '1'}"
            curve = response[row, at]
            with np.errstate(divide="ignore"):  # a response that is zero has no decibels
                above.semilogx(frequencies, _decibels(np.abs(curve)), color=AFTER)
            above.set_title(plain(f"{given} to {measured}"))
            above.set_ylabel(plain(f"magnitude [dB of {unit}]"))
            below.semilogx(frequencies, np.degrees(np.unwrap(np.angle(curve))), color=AFTER)
            below.set_ylabel("phase [deg]")
            below.set_xlabel("frequency [Hz]")
            _draw_margins(above, below, own)
        letters = round(22 * figure.get_size_inches()[0])
        point = "\n".join(textwrap.wrap(f"at {_operating_point(answer)}", letters))
        figure.suptitle(plain(point), x=0.01, ha="left", fontsize="small")
    return figure


def _holding(frequencies: np.ndarray[Any, Any], found: Sequence[Margins]) -> np.ndarray[Any, Any]:
    """Frequencies as many and as wide, and wider where a margin is taken beyond them."""
    taken = [one.phase_frequency for one in found if np.isfinite(one.phase)]
    low, high = min([frequencies[0], *taken]), max([frequencies[-1], *taken])
    wider = np.geomspace(low, high, frequencies.size)
    return frequencies if (low, high) == (frequencies[0], frequencies[-1]) else wider


def _decibels(magnitude: np.ndarray[Any, Any] | float) -> Any:
    return 20.0 * np.log10(magnitude)


def _draw_margins(above: Axes, below: Axes, found: Margins) -> None:
    """Where margins are taken, as lines, and their numbers in the panels."""
    told = "no gain margin: the phase never is -180 deg"
    if np.isfinite(found.gain):
        told = f"gain margin {shown(_decibels(found.gain))} dB at {shown(found.gain_frequency)} Hz"
        above.axvline(found.gain_frequency, color=BEFORE, linewidth=0.8, linestyle="--")
    style: dict[str, Any] = {"xycoords": "axes fraction", "fontsize": "small", "color": BEFORE, "bbox": _OVER_CURVES}
    above.annotate(told, (0.03, 0.04), **style)
    told = "no phase margin: the magnitude never is 0 dB"
    if np.isfinite(found.phase):
        told = f"phase margin {shown(np.degrees(found.phase))} deg at {shown(found.phase_frequency)} Hz"
        below.axvline(found.phase_frequency, color=BEFORE, linewidth=0.8, linestyle="--")
    below.annotate(told, (0.03, 0.04), **style)


def _operating_point(answer: LinearAnswer) -> str:
    """States and inputs with their values, in declared units."""
    model, equations = answer.model, answer.equations
    quantities: list[tuple[str, Displayed, float]] = [
        *zip(model.states, equations.states, model.x.tolist(), strict=True),
        *zip(model.inputs, equations.inputs, model.u.tolist(), strict=True),
    ]
    units = ("" if one.display_unit == "1" else one.display_unit for _, one, _ in quantities)
    values = [
        f"{name} = {one.shown(value):.4g} {unit}".strip()
        for (name, one, value), unit in zip(quantities, units, strict=True)
    ]
    return ", ".join(values) or "every point"


def _index(names: Sequence[str], name: str, kind: str) -> int:
    if name not in names:
        raise OptionError(f"{name}: no {kind} of this name{suggest(name, names)}", where=(name,))
    return list(names).index(name)
