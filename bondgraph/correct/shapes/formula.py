"""A formula at a place: a sum of terms with a coefficient each, as an element of the graph, as text, and as Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from sympy import Add, Expr, Function, Symbol

from bondgraph.correct.places.probes import Variable, argument
from bondgraph.correct.places.regimes import in_words
from bondgraph.correct.shapes.law_text import Intervals, letters_beside, python_text, rounded, with_numbers
from bondgraph.correct.shapes.library import Term, identifier
from bondgraph.data.log import FloatArray
from bondgraph.declare.effect import Effect, EffectFunction, Place
from bondgraph.declare.expressions import to_text
from bondgraph.declare.graph import BondGraph

#: Coefficients are searched up to this many times what would make the term as large as the efforts (flows) there.
_REACH = 2.0
#: Digits of a constant of a law in lines that a machine reads.
_CONSTANT_DIGITS = 6
#: Where the functions of laws are imported from.
_SOURCES = {"sympy": ("Abs", "cos", "exp", "sin", "tanh"), "bondgraph.declare.functions": ("maximum",)}


@dataclass(frozen=True)
class Coefficient:
    """A parameter of a formula: its name, its unit, what it is; of an inner one its bounds and start, else its size."""

    name: str
    unit: str
    meaning: str
    start: float
    bounds: tuple[float, float]


@dataclass(frozen=True, repr=False)
class Formula:
    """A law for what is missing at a place: the sum of terms, each times a coefficient.

    ``unit`` is that of the missing effort or flow, taken away where it is positive; ``sizes`` say how large each law of
    the terms becomes in the logs for a coefficient of one.
    """

    place: Place
    variable: Variable
    unit: str
    terms: tuple[Term, ...]
    sizes: tuple[float, ...]

    def __repr__(self) -> str:
        return f"<Formula {self.text()} at {self.place.label}>"

    @property
    def name(self) -> str:
        """Name of the effect, unique for the terms."""
        return "formula_" + "_and_".join(
            f"{'_and_'.join(term.kind.name for term in terms)}_of_{identifier(' and '.join(signals))}"
            for signals, terms in groupby(self.terms, lambda term: term.signals)
        )

    @property
    def element(self) -> str:
        """Name of the element that carries it in the graph."""
        return f"{self.name}_{self.place.name}"

    @property
    def _label(self) -> str:
        """End of the names of its parameters: the terms and the place, a flow or effort of its own unsaid."""
        words = self.name.removeprefix("formula_")
        return f"{words.removesuffix(f'_of_{identifier(self.signals[0])}') if self.is_own else words}_{self.place.name}"

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals, each once."""
        return tuple(dict.fromkeys(name for term in self.terms for name in term.signals))

    def coefficients(self) -> list[Coefficient]:
        """A coefficient for every law of every term."""
        limit = _REACH * (self.place.scale.effort if self.variable == "effort" else self.place.scale.flow)
        named = [
            (f"c{k + 1}_{self._label}" if self._several else f"c_{self._label}", term)
            for k, term in enumerate(term for term in self.terms for _ in term.kind.laws)
        ]
        return [
            Coefficient(name, _over(self.unit, term), f"coefficient of the {term.kind.name}", 0.0, (-top, top))
            for (name, term), size in zip(named, self.sizes, strict=True)
            for top in (limit / size,)
        ]

    def inner(self) -> list[Coefficient]:
        """The inner parameters of terms that have one."""
        return [
            Coefficient(
                f"{term.kind.inner}{k + 1 if self._several else ''}_{self._label}", term.inner_unit,
                f"{term.kind.inner} of the {term.kind.name}", term.inner, term.span,
            )
            for k, term in enumerate(self.terms)
            if term.kind.inner
        ]  # fmt: skip

    @property
    def _several(self) -> bool:
        return len(self.sizes) > 1

    def law(self, known: Mapping[str, Expr], read: bool = False) -> Expr:
        """The law in signals of the graph, with coefficients and inner parameters by name; ``read``: for a person."""
        inner, parts = iter(self.inner()), []
        coefficients = iter(self.coefficients())
        for term in self.terms:
            laws = term.laws(known[next(inner).name] if term.kind.inner else None, read)
            parts += [known[next(coefficients).name] * law for law in laws]
        return Add(*parts)

    def curve(self, values: Mapping[str, float], x: FloatArray) -> FloatArray:
        """A formula of one signal at values of it, both (n,)."""
        inner, coefficients = iter(self.inner()), iter(self.coefficients())
        found = np.zeros(x.shape)
        for term in self.terms:
            laws = term.values(x, values[next(inner).name] if term.kind.inner else None)
            found += np.sum([values[next(coefficients).name] * law for law in laws], axis=0)
        return found

    def effect(self) -> EffectFunction:
        """The formula as an effect function; it keeps the formula, see :func:`formula_of`."""

        def declared(g: BondGraph, at: Place) -> Effect | None:
            if at.label != self.place.label or at.output:
                return None
            every = [*self.coefficients(), *self.inner()]
            known = {one.name: g.parameter(one.name, one.start, one.unit, one.meaning, one.bounds) for one in every}
            self._declare(g, at, self.law(known))
            return Effect(
                self.name, self.element, self.text(), tuple(one.name for one in self.coefficients()),
                shapes=tuple(one.name for one in self.inner()), formula=True,
            )  # fmt: skip

        declared.__name__ = self.name
        declared.__dict__["formula"] = self
        return declared

    @property
    def is_own(self) -> bool:
        """Whether it depends on the flow (effort) of its place alone: a resistance."""
        return self.signals == (f"{'flow' if self.variable == 'effort' else 'effort'} of {self.place.label}",)

    def _declare(self, g: BondGraph, at: Place, law: Expr) -> None:
        if self.is_own:
            own = argument(self.signals[0])
            if self.variable == "effort":
                g.resistance(self.element, lambda flow: law.xreplace({own: flow}), at=at.junction)
            else:
                g.resistance(self.element, flow=lambda effort: law.xreplace({own: effort}), at=at.junction)
        elif self.variable == "effort":
            g.effort_source(self.element, -law, at=at.junction)
        else:
            g.flow_source(self.element, -law, at=at.junction)

    def text(self, values: Mapping[str, float] | None = None, ends: Intervals | None = None) -> str:
        """The law as a person reads it, with the values of its parameters where they are given.

        These have as many digits as the ``ends`` of their intervals support, three where there are none.

        Examples
        --------
        >>> from bondgraph.correct.shapes.library import library
        >>> from bondgraph.correct.places.probes import Signal
        >>> from bondgraph.declare.effect import Scale
        >>> from bondgraph.declare.graph import Handle
        >>> import numpy as np
        >>> way = Signal("displacement of spring", "m", (np.array([-0.2, 0.1, 0.2]),))
        >>> cube = next(term for term in library([way], way) if term.kind.name == "cube")
        >>> place = Place(Handle("body", "1", None), Scale(1.0, 1.0))
        >>> found = Formula(place, "effort", "N", (cube,), (0.008,))
        >>> found.text(), found.text({found.coefficients()[0].name: 3.7812})
        ('effort = c*x^3, x the displacement of spring', 'effort = 3.78*x^3  [N], x the displacement of spring')
        >>> found.text({found.coefficients()[0].name: 3.7812}, {found.coefficients()[0].name: (2.6, 4.9)})
        'effort = 3.8*x^3  [N], x the displacement of spring'
        """
        every = [*self.coefficients(), *self.inner()]
        letters = dict(zip(map(argument, self.signals), letters_beside(self.signals), strict=False))
        if values is None:
            short = {one.name: Symbol(one.name.partition("_")[0]) for one in every}
            law = with_numbers(self.law(short, read=True).xreplace(letters), {})
        else:
            named = {one.name: Symbol(one.name) for one in every}
            own = {one.name: values[one.name] for one in every}
            law = with_numbers(self.law(named, read=True).xreplace(letters), own, ends)
        unit = f"  [{self.unit}]" if values is not None and self.unit else ""
        units = {name: unit for term in self.terms for name, unit in zip(term.signals, term.units, strict=True)}
        words = " and ".join(
            f"{letters[argument(one)]} the {in_words(one, units[one])}"
            for one in self.signals
            if argument(one) in letters
        )
        return f"{self.variable} = {law}{unit}, {words}"

    def python(self, values: Mapping[str, float], ends: Intervals | None = None) -> str:
        """Lines of Python that declare the formula in a graph ``g``, with the values of its parameters.

        With the ``ends`` of their intervals these are rounded to what that supports, without they are exact.
        """
        every = [*self.coefficients(), *self.inner()]
        letters = dict(zip(map(argument, self.signals), letters_beside(self.signals), strict=False))
        short = {one.name: Symbol(one.name.partition("_")[0]) for one in every}
        law = self.law(short).xreplace(letters)
        used = {type(one).__name__ for one in law.atoms(Function)}
        lines = [f"from {room} import {name}" for room, names in _SOURCES.items() for name in names if name in used]
        lines += _signal_lines({name: letters[argument(name)].name for name in self.signals if not self.is_own})
        for one in every:
            value = values[one.name] if ends is None else float(rounded(values[one.name], ends.get(one.name)))
            bounds = tuple(value if ends is None else float(rounded(value)) for value in one.bounds)
            bounds = (min(bounds[0], value), max(bounds[1], value))
            own = short[one.name].name
            lines.append(f"{own} = g.parameter({one.name!r}, {value!r}, {one.unit!r}, {one.meaning!r}, {bounds!r})")
        text = to_text(law) if ends is None else python_text(law, _CONSTANT_DIGITS)
        at = self.place.junction.name
        kind = "effort" if self.variable == "effort" else "flow"
        if self.is_own:
            law_of = f"lambda x: {text}" if kind == "effort" else f"flow=lambda x: {text}"
            return "\n".join([*lines, f"g.resistance({self.element!r}, {law_of}, at={at!r})"])
        return "\n".join([*lines, f"g.{kind}_source({self.element!r}, -({text}), at={at!r})"])


def _signal_lines(letters: Mapping[str, str]) -> list[str]:
    """Lines of Python that give signals and inputs short names."""
    imports, lines = [], []
    for name, letter in letters.items():
        variable, separator, node = name.partition(" of ")
        if separator:
            imports.append("from bondgraph.declare.expressions import signal")
            lines.append(f"{letter} = signal({variable!r}, {node!r})")
        else:
            imports.append("from bondgraph.declare.quantities import symbol")
            lines.append(f"{letter} = symbol({name!r})")
    return [*dict.fromkeys(imports), *lines]


def formula_of(function: EffectFunction) -> Formula | None:
    """The formula that an effect function declares, None for a law of a dictionary."""
    found = function.__dict__.get("formula")
    return found if isinstance(found, Formula) else None


def is_long(function: EffectFunction) -> bool:
    """True for a formula of several terms, which comes near any function and is no law where it leaves a part of it."""
    formula = formula_of(function)
    return formula is not None and len(formula.terms) > 1


def _over(unit: str, term: Term) -> str:
    """Unit of the coefficient of a term."""
    found = _divided(unit, term.argument_unit, term.kind.power)
    return _divided(found, term.units[1], term.kind.second_power) if term.kind.has_second else found


def _divided(unit: str, below: str, power: int) -> str:
    """A unit over a power of another one; empty where one is not known."""
    if power == 0 or below == "1" or not unit:
        return unit
    if not below:
        return ""
    whole = below if below.isalpha() else f"({below})"
    return f"{unit}/{whole}" + (f"^{power}" if power > 1 else "")
