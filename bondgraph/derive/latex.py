r"""State equations as LaTeX: aligned assignments, state equations and outputs, and a list of what the symbols mean.

Names become the symbols an engineer would write: ``omega_primary`` is :math:`\omega_{\mathrm{primary}}`, ``J2`` is
:math:`J_{2}`, ``motor.k_m`` is :math:`k_{\mathrm{m},\,\mathrm{motor}}`. Two names never share one symbol. The text
needs the package ``amsmath`` and is the same for the same equations on every machine.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from sympy import Expr
from sympy.printing.latex import LatexPrinter

from bondgraph.declare.functions import TableFunction
from bondgraph.derive.equations import Assignment, ImplicitLoop, OutputEquation, StateEquations

_GREEK = (
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi",
    "pi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi",
    "Pi", "Sigma", "Upsilon", "Phi", "Psi", "Omega",
)  # fmt: skip
_WORD = re.compile(r"([A-Za-z]+?)(\d*)\Z")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*(\.[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*)*\Z")
_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "%": r"\%", "#": r"\#", "_": r"\_",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
}  # fmt: skip
#: Lines of equations that a notebook shows with their intermediate results.
_SHOWN = 40
_UNITS = {"ohm": r"\Omega", "degC": r"{}^{\circ}\mathrm{C}", "%": r"\%"}


def latex(equations: StateEquations, assignments: bool = True) -> str:
    r"""Equations as LaTeX text.

    Parameters
    ----------
    equations
        As derived.
    assignments
        Also the named intermediate results, in order of computation.

    Returns
    -------
    str
        ``align*`` environments (state equations last but for the outputs) and an ``itemize`` list of symbols with unit,
        value and meaning.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("car")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("engine", g.input("F_engine", "N"), at=body)
    >>> _ = g.inertance("mass", g.parameter("m", 800.0, "kg"), at=body, state="v")
    >>> print(latex(derive(assign_causality(g))))
    \begin{align*}
    \dot{v} &= \frac{F_{\mathrm{engine}}}{m}
    \end{align*}
    where
    \begin{itemize}
    \item $v$: flow of mass (state)
    \item $F_{\mathrm{engine}}$ [$\mathrm{N}$] (input)
    \item $m = 800$ [$\mathrm{kg}$] (parameter)
    \end{itemize}
    """
    computed = _computed(equations)
    printer = _Printer(_symbols(equations, computed))
    parts = [_aligned(block) for block in _blocks(equations, printer, computed, assignments) if block]
    return "\n".join([*parts, *_where(equations, printer, assignments)])


def display_latex(equations: StateEquations) -> str:
    r"""Equations between dollar signs, as notebooks show them: no meanings, long ones without intermediate results.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("car")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", g.parameter("m", 800.0, "kg"), at=body, state="v")
    >>> print(display_latex(derive(assign_causality(g))))
    $$\begin{aligned}
    \dot{v} &= 0
    \end{aligned}$$
    """
    computed = _computed(equations)
    printer = _Printer(_symbols(equations, computed))
    blocks = _blocks(equations, printer, computed, assignments=True)
    left = 0
    if sum(map(len, blocks)) > _SHOWN:
        left, blocks = len(blocks[0]), [[], *blocks[1:]]
    lines = [line for block in blocks for line in block] or [r"\text{no states}"]
    if left:
        lines.insert(0, rf"&\text{{after {left} assignments in order of computation:}}")
    return "$$\\begin{aligned}\n" + " \\\\\n".join(lines) + "\n\\end{aligned}$$"


def _blocks(
    equations: StateEquations, printer: _Printer, computed: Sequence[str], assignments: bool
) -> list[list[str]]:
    """Intermediate results, state equations and outputs, a line for each."""
    steps = _steps(equations, printer) if assignments else []
    rates = [
        f"{printer.rate(state.symbol.name)} &= {printer.doprint(rate)}"
        for state, rate in zip(equations.states, equations.derivatives, strict=True)
    ]
    outputs = [
        f"{printer.name(_output_key(y, computed))} &= {printer.doprint(y.expression)}"
        for y in equations.outputs
        if y.expression != y.symbol  # what is measured as it is has its equation already
    ]
    return [steps, rates, outputs]


def _aligned(lines: Sequence[str]) -> str:
    body = " \\\\\n".join(lines)
    return f"\\begin{{align*}}\n{body}\n\\end{{align*}}"


def _steps(equations: StateEquations, printer: _Printer) -> list[str]:
    lines = []
    for step in equations.assignments:
        local = step.body if isinstance(step, ImplicitLoop) else (step,)
        lines += [f"{printer.name(a.symbol.name)} &= {printer.doprint(a.expression)}" for a in local]
        if isinstance(step, ImplicitLoop):
            unknowns = ", ".join(printer.name(unknown.name) for unknown in step.unknowns)
            solved = rf" \quad \text{{(solved for ${unknowns}$)}}"
            residuals = [f"0 &= {printer.doprint(residual)}" for residual in step.residuals]
            lines += [*residuals[:-1], residuals[-1] + solved]
    return lines


# ---------------------------------------------------------------------- symbols


def _symbols(equations: StateEquations, computed: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Letter and subscript of every name, in order of declaration and computation; none twice."""
    known: dict[str, tuple[str, str]] = {}
    shown: set[tuple[str, str]] = set()
    declared = {parameter.name for parameter in equations.parameters}
    declared |= {signal.name for signal in equations.inputs if not signal.meaning.startswith("rate of ")}
    keys = (_output_key(output, computed) for output in equations.outputs)
    for name in dict.fromkeys([*computed, *keys]):
        rate_of = name.removeprefix("d_")
        if name != rate_of and rate_of in known and name not in declared:
            letter, index = known[rate_of]
            symbol = (rf"\dot{{{letter}}}", index)
        else:
            symbol = _symbol(name)
        if symbol in shown:
            symbol = (rf"\mathtt{{{_escaped(name)}}}", "")
        known[name] = symbol
        shown.add(symbol)
    return known


def _computed(equations: StateEquations) -> list[str]:
    """Names of all that is declared or computed."""
    return list(dict.fromkeys(_declared(equations)))


def _declared(equations: StateEquations) -> Iterable[str]:
    yield "t"
    yield from (state.symbol.name for state in equations.states)
    yield from (signal.name for signal in equations.inputs)
    yield from (parameter.name for parameter in equations.parameters)
    for step in equations.assignments:
        if isinstance(step, Assignment):
            yield step.symbol.name
        else:
            yield from (symbol.name for symbol in (*step.unknowns, *(local.symbol for local in step.body)))


def _output_key(output: OutputEquation, computed: Sequence[str]) -> str:
    """The name of an output, with a y before it where something else has that name."""
    own = str(output.symbol)
    if output.expression == output.symbol:
        return own
    while own in computed:
        own = f"y_{own}"
    return own


def _symbol(name: str) -> tuple[str, str]:
    r"""Letter and subscript of a name.

    Examples
    --------
    >>> _symbol("omega_primary"), _symbol("J2"), _symbol("cd_area")
    (('\\omega', '\\mathrm{primary}'), ('J', '2'), ('\\mathrm{cd}', '\\mathrm{area}'))
    """
    if not _NAME.match(name):
        return r"\mathrm{" + _escaped(name).replace("->", r"{\to}") + "}", ""
    *parts, own = name.split(".")
    first, *rest = own.split("_")
    letter, digits = _split(first)
    index = [*([digits] if digits else []), *map(_word, rest)]
    inside = r"\,".join(index)
    outside = [r"\,".join(map(_word, part.split("_"))) for part in parts]
    return letter, r",\,".join([*([inside] if inside else []), *outside])


def _split(word: str) -> tuple[str, str]:
    """A word as a letter and the digits behind it."""
    found = _WORD.match(word)
    letters, digits = (found[1], found[2]) if found else (word, "")
    if letters in _GREEK:
        return f"\\{letters}", digits
    return (letters if len(letters) == 1 else rf"\mathrm{{{letters}}}"), digits


def _word(word: str) -> str:
    """A word of a subscript."""
    if word.isdigit():
        return word
    return f"\\{word}" if word in _GREEK else rf"\mathrm{{{word}}}"


class _Printer(LatexPrinter):  # type: ignore[misc]
    """sympy's LaTeX with the names of the equations and the functions of laws."""

    def __init__(self, symbols: dict[str, tuple[str, str]]) -> None:
        super().__init__({"mul_symbol": r" \, "})
        self.symbols = symbols

    def name(self, name: str) -> str:
        """The symbol of a name."""
        letter, index = self.symbols[name]
        return f"{letter}_{{{index}}}" if index else letter

    def rate(self, name: str) -> str:
        """The symbol of the time derivative of a name."""
        letter, index = self.symbols[name]
        return rf"\dot{{{letter}}}" + (f"_{{{index}}}" if index else "")

    def _as_ordered_terms(self, expression: Expr, order: str | None = None) -> list[Expr]:
        """Terms with a plus before terms with a minus."""
        terms = super()._as_ordered_terms(expression, order)
        return sorted(terms, key=lambda term: bool(term.could_extract_minus_sign()))

    def _print_Symbol(self, expression: Expr, style: str = "plain") -> str:
        return (
            self.name(expression.name)
            if expression.name in self.symbols
            else rf"\mathtt{{{_escaped(str(expression))}}}"
        )

    def _call(self, function: str, expression: Expr, exp: str | None) -> str:
        arguments = ", ".join(self._print(argument) for argument in expression.args)
        power = f"^{{{exp}}}" if exp is not None else ""
        return rf"{function}{power}\left({arguments}\right)"

    def _print_minimum(self, expression: Expr, exp: str | None = None) -> str:
        return self._call(r"\min", expression, exp)

    def _print_maximum(self, expression: Expr, exp: str | None = None) -> str:
        return self._call(r"\max", expression, exp)

    def _print_Function(self, expression: Any, exp: str | None = None) -> str:
        if not isinstance(expression, TableFunction):
            return str(super()._print_Function(expression, exp))
        name = rf"\operatorname{{{_escaped(expression.table_name)}}}"
        if len(expression.args) == 1:
            return self._call(name + "'" * sum(expression.derivative), expression, exp)
        marks = "".join(str(i + 1) * order for i, order in enumerate(expression.derivative))
        return self._call((rf"\partial_{{{marks}}}" if marks else "") + name, expression, exp)


# ---------------------------------------------------------------------- what the symbols mean


def _where(equations: StateEquations, printer: _Printer, assignments: bool) -> list[str]:
    items = []
    for state in equations.states:
        items.append(_item(printer.name(state.symbol.name), state.unit, state.meaning, "state"))
    for signal in equations.inputs:
        items.append(_item(printer.name(signal.name), signal.unit, signal.meaning, "input"))
    for parameter in equations.parameters:
        symbol = f"{printer.name(parameter.name)} = {_number(parameter.value)}"
        items.append(_item(symbol, parameter.unit, parameter.meaning, "parameter"))
    for table in equations.tables:
        items.append(_item(rf"\operatorname{{{_escaped(table.name)}}}", table.unit, table.meaning, "table"))
    for step in equations.assignments if assignments else ():
        if isinstance(step, Assignment):
            items.append(_item(printer.name(step.symbol.name), step.unit, step.meaning, ""))
        else:
            pairs = zip(step.unknowns, step.units, strict=True)
            items += [_item(printer.name(unknown.name), unit, step.meaning, "") for unknown, unit in pairs]
            items += [_item(printer.name(local.symbol.name), local.unit, local.meaning, "") for local in step.body]
    for output in equations.outputs:
        symbol = printer.name(_output_key(output, _computed(equations)))
        items.append(_item(symbol, output.unit, output.meaning, "output"))
    return ["where", r"\begin{itemize}", *items, r"\end{itemize}"] if items else []


def _item(symbol: str, unit: str, meaning: str, role: str) -> str:
    shown = f" [${_unit(unit)}$]" if unit else ""
    text = f": {_escaped(' '.join(meaning.split()))}" if meaning.strip() else ""
    return rf"\item ${symbol}${shown}{text}" + (f" ({role})" if role else "")


def _number(value: float) -> str:
    """A number as it is written, powers of ten as such."""
    mantissa, _, exponent = f"{value:.12g}".partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa


def _unit(unit: str) -> str:
    r"""A unit string in upright letters with raised powers.

    Examples
    --------
    >>> _unit("kg m^2"), _unit("rad/s"), _unit("V/(ohm*s)")
    ('\\mathrm{kg}\\,\\mathrm{m}^{2}', '\\mathrm{rad}/\\mathrm{s}', '\\mathrm{V}/(\\Omega\\,\\mathrm{s})')
    """
    text = re.sub(r"\s*([/*^])\s*", r"\1", unit.strip().replace("**", "^"))
    tokens = re.findall(r"\^\(?([-+]?[\d./]+)\)?|([A-Za-z_µ°%]+)|([\d.]+)|([*\s]+)|(.)", text)
    parts = []
    for power, word, number, _, other in tokens:
        if power:
            parts.append(f"^{{{power}}}")
        elif word:
            parts.append(_UNITS.get(word, rf"\mathrm{{{_escaped(word)}}}"))
        else:
            parts.append(number or (other if other else r"\,"))
    return "".join(parts)


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(character, character) for character in text)
