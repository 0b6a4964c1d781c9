"""Definitions: with every stroke placed, each bond variable is given by exactly one rule.

A variable is known by a key. Efforts that are equal at a 0-junction, and flows that are equal at a 1-junction, are one
variable. Keys: ``("e", i)`` and ``("f", i)`` bond variables, ``("x", name)`` states, ``("d", key)`` the time derivative
of a variable, ``("q", node, port)`` the energy variable of a storage in derivative causality, ``("m", node)`` a
modulus, ``("s", name)`` a named signal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sympy import Add, Expr, Integer, Mul, Symbol

from bondgraph.derive.laws import slope
from bondgraph.errors import DerivationError

Key = tuple[Any, ...]
Values = Mapping[Key, Expr]

ONE = Integer(1)
ZERO = Integer(0)


@dataclass(frozen=True)
class Sum:
    """A junction's sum: the variable is the signed sum of others."""

    terms: tuple[tuple[int, Key], ...]

    @property
    def depends(self) -> tuple[Key, ...]:
        """Keys the rule uses."""
        return tuple(key for _, key in self.terms)

    def build(self, values: Values) -> Expr:
        """The rule as an expression of the values of what it depends on."""
        return Add(*(values[key] if sign > 0 else -values[key] for sign, key in self.terms))

    def partials(self, values: Values) -> list[tuple[Key, Expr]]:
        """Derivative with respect to each key it depends on."""
        return [(key, Integer(sign)) for sign, key in self.terms]


@dataclass(frozen=True)
class Law:
    """An element's law: an expression whose local symbols stand for variables, each with a sign."""

    template: Expr
    arguments: tuple[tuple[Symbol, Key, int], ...]

    @property
    def depends(self) -> tuple[Key, ...]:
        """Keys the rule uses."""
        return tuple(dict.fromkeys(key for _, key, _ in self.arguments))

    def substitution(self, values: Values) -> dict[Symbol, Expr]:
        """What each local symbol becomes."""
        return {local: values[key] if sign > 0 else -values[key] for local, key, sign in self.arguments}

    def build(self, values: Values) -> Expr:
        """The rule as an expression of the values of what it depends on."""
        return self.template.xreplace(self.substitution(values))

    def partials(self, values: Values) -> list[tuple[Key, Expr]]:
        """Derivative with respect to each key it depends on (a key used twice appears twice)."""
        replace = self.substitution(values)
        found = []
        for local, key, sign in self.arguments:
            partial = slope(self.template, local)
            if partial != 0:
                found.append((key, (partial if sign > 0 else -partial).xreplace(replace)))
        return found


@dataclass(frozen=True)
class Scaled:
    """A variable times (or divided by) another: transformers and gyrators."""

    factor: Key
    of: Key
    inverted: bool

    @property
    def depends(self) -> tuple[Key, ...]:
        """Keys the rule uses."""
        return (self.factor, self.of)

    def build(self, values: Values) -> Expr:
        """The rule as an expression of the values of what it depends on."""
        factor, of = values[self.factor], values[self.of]
        return of / factor if self.inverted else Mul(factor, of)

    def partials(self, values: Values) -> list[tuple[Key, Expr]]:
        """Derivative with respect to each key it depends on."""
        factor, of = values[self.factor], values[self.of]
        if self.inverted:
            return [(self.factor, -of / factor**2), (self.of, ONE / factor)]
        return [(self.factor, of), (self.of, factor)]


@dataclass(frozen=True)
class Residual:
    """A law given implicitly: ``template = 0`` in the variable itself (``own``) and others; ``guess`` is near it."""

    template: Expr
    own: Symbol
    own_sign: int
    arguments: tuple[tuple[Symbol, Key, int], ...]
    guess: Expr = ZERO

    @property
    def law(self) -> Law:
        """The residual as an ordinary law of its arguments, ``own`` left in place."""
        return Law(self.template, self.arguments)

    @property
    def depends(self) -> tuple[Key, ...]:
        """Keys the rule uses, without the variable itself."""
        return self.law.depends

    def residual(self, own_value: Expr, values: Values) -> Expr:
        """The residual at a value of the variable."""
        own = own_value if self.own_sign > 0 else -own_value
        return self.template.xreplace({**self.law.substitution(values), self.own: own})

    def own_slope(self, own_value: Expr, values: Values) -> Expr:
        """Derivative of the residual with respect to the variable itself."""
        own = own_value if self.own_sign > 0 else -own_value
        partial = slope(self.template, self.own)
        replaced = partial.xreplace({**self.law.substitution(values), self.own: own})
        return replaced if self.own_sign > 0 else -replaced

    def partials_at(self, own_value: Expr, values: Values) -> list[tuple[Key, Expr]]:
        """Derivative of the residual with respect to each argument."""
        own = own_value if self.own_sign > 0 else -own_value
        return [(key, partial.xreplace({self.own: own})) for key, partial in self.law.partials(values)]


@dataclass(frozen=True)
class Rate:
    """The time derivative of a variable by the chain rule through its own definition.

    ``explicit`` holds the symbols whose own rates are known directly: inputs and time.
    """

    of: Key
    definition: Sum | Law | Scaled | Residual
    explicit: tuple[tuple[Symbol, Expr], ...]
    constant: tuple[Key, ...] = ()

    @property
    def depends(self) -> tuple[Key, ...]:
        """Rates of what the variable depends on, and the variables at which the slopes are taken."""
        inner = self.definition.depends
        rates = tuple(("d", key) for key in inner if key not in self.constant)
        at = () if isinstance(self.definition, Sum) else inner
        own = (self.of,) if isinstance(self.definition, Residual) else ()
        return (*rates, *at, *own)

    def partials(self, values: Values) -> list[tuple[Key, Expr]]:
        """Derivative with respect to the other rates; slopes are coefficients, since rates enter linearly."""
        if isinstance(self.definition, Residual):
            scale = -ONE / self.definition.own_slope(values[self.of], values)
            pairs = self.definition.partials_at(values[self.of], values)
            return [(("d", key), scale * partial) for key, partial in pairs if key not in self.constant]
        return [(("d", k), partial) for k, partial in self.definition.partials(values) if k not in self.constant]

    def build(self, values: Values) -> Expr:
        """The rate as an expression of other rates."""
        terms = [partial * values[key] for key, partial in self.partials(values)]
        return Add(*terms, *self._explicit_terms(values))

    def _explicit_terms(self, values: Values) -> list[Expr]:
        if isinstance(self.definition, Sum | Scaled):
            return []
        template = self.definition.template
        residual = isinstance(self.definition, Residual)
        law = self.definition.law if isinstance(self.definition, Residual) else self.definition
        replace = law.substitution(values)
        scale = ONE
        if isinstance(self.definition, Residual):
            own = values[self.of] if self.definition.own_sign > 0 else -values[self.of]
            replace = {**replace, self.definition.own: own}
            scale = -ONE / self.definition.own_slope(values[self.of], values)
        slopes = [(slope(template, used), rate) for used, rate in self.explicit]
        terms = [partial.xreplace(replace) * rate for partial, rate in slopes if partial != 0 and rate != 0]
        return [scale * term for term in terms] if residual else terms


@dataclass(frozen=True)
class Constrained:
    """The effort of an element with modes: what keeps its flow at zero, or ``slip`` where it is free.

    ``rate`` is that of the flow, ``constrained`` the condition under which it stays zero; ``static`` is what the
    element can hold, ``sign`` that of the flow as the element counts it. The rule is solved in
    :mod:`bondgraph.derive.locking`, as a part of the loop from effort to rate to effort.
    """

    element: str
    rate: Key
    constrained: Expr
    slip: Law
    static: Law
    sign: int

    @property
    def depends(self) -> tuple[Key, ...]:
        """Keys the rule uses."""
        return (self.rate, *self.slip.depends, *self.static.depends)

    def partials(self, values: Values) -> list[tuple[Key, Expr]]:
        """None: the rule is no explicit function."""
        return []

    def build(self, values: Values) -> Expr:
        """Refuse: outside of a loop, the flow does not react to the effort."""
        raise self.refusal()

    def rate_refusal(self) -> DerivationError:
        """The error for an effort whose rate a dependent storage needs."""
        return DerivationError(
            f"{self.element}: its effort jumps when its mode changes, but a storage in derivative causality needs the "
            "rate of it - separate them by another storage, or derive the graph smooth",
            where=(self.element,),
        )

    def refusal(self) -> DerivationError:
        """The error for an element whose flow does not react to its effort."""
        return DerivationError(
            f"{self.element}: its flow is imposed and does not react to its own effort, so it cannot lock or rebound - "
            "give its junction an inertance, or derive the graph smooth",
            where=(self.element,),
        )


Definition = Sum | Law | Scaled | Residual | Rate | Constrained
