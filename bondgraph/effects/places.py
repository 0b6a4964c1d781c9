"""What effects share: what they are called, where they make sense, how large their coefficients are, in which units."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sympy import Expr, Symbol

from bondgraph.declare.domains import CHEMICAL, ELECTRICAL, HYDRAULIC, THERMAL
from bondgraph.declare.effect import Place
from bondgraph.declare.elements import TWO_PORTS, Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import Input, symbol
from bondgraph.declare.revision import revise_integral
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.laws import linear_coefficient

#: Law and reference of a delay, see :func:`delayed`.
DELAY_LAW = "by (1 - s*T/3)/(1 + 2*s*T/3 + (s*T)^2/6)"
PADE = "Golub, Van Loan (2013), Matrix Computations, section 9.3, for the approximations of Pade"
#: Exponents beyond one of a bent map or line, from a root of the third degree to a fourth power. A convention.
BENT = (-0.67, 3.0)


@dataclass(frozen=True)
class Words:
    """What one law is called in each domain; empty where it has no meaning there.

    Mechanical words serve rotation, translation and junctions whose domain is not declared or not the toolkit's own.
    """

    mechanical: str = ""
    electrical: str = ""
    hydraulic: str = ""
    thermal: str = ""
    chemical: str = ""

    def at(self, at: Place) -> str:
        """The name of the law at a place.

        Examples
        --------
        >>> from bondgraph.declare.domains import HYDRAULIC
        >>> from bondgraph.declare.effect import Scale
        >>> Words("creep", hydraulic="leakage").at(Place(Handle("tank", "0", HYDRAULIC), Scale(1e5, 1e-4)))
        'leakage'
        """
        domain = at.domain
        return self.mechanical if domain is None or domain not in _FAMILIES else getattr(self, _FAMILIES[domain])


#: Domains whose words differ from those of mechanics.
_FAMILIES = {ELECTRICAL: "electrical", HYDRAULIC: "hydraulic", THERMAL: "thermal", CHEMICAL: "chemical"}


def has_flow(at: Place) -> bool:
    """A 1-junction of any domain: a loss there takes an effort."""
    return at.bond is None and at.junction.kind == "1"


def has_effort(at: Place) -> bool:
    """A 0-junction of any domain: a loss there takes a flow."""
    return at.bond is None and at.junction.kind == "0"


def is_motion(at: Place) -> bool:
    """A 1-junction whose flow is a speed, or has no declared domain."""
    return has_flow(at) and at.domain not in _FAMILIES


def is_speed(at: Place) -> bool:
    """Losses and loads act on a 1-junction of a domain in which flow is a motion or current."""
    return at.bond is None and at.junction.kind == "1" and at.domain not in (THERMAL, CHEMICAL)


def effort_unit(at: Place) -> str:
    """Unit of the effort there, empty where the domain is not declared."""
    return "" if at.domain is None else at.domain.effort_unit


def flow_unit(at: Place) -> str:
    """Unit of the flow there, empty where the domain is not declared."""
    return "" if at.domain is None else at.domain.flow_unit


def lateness(at: Place) -> tuple[float, tuple[float, float]]:
    """Where the search for a delay or a lag begins, and its bounds, in s.

    From a tenth of the interval between samples to forty of them, and to two seconds at least: what is slower than that
    is a part of the machine that somebody would have named.
    """
    shortest, _ = at.times
    bounds = (0.1 * shortest, max(2.0, 40.0 * shortest))
    return (bounds[0] * bounds[1]) ** 0.5, bounds


def delays_at(at: Place) -> tuple[list[int], float]:
    """Delays of a command, in intervals of so many s; between two of them a law takes a mean of both.

    Everywhere: none, one, two, three, four, six and so on, beyond what :func:`lateness` bounds: they tell where to look
    closer. Near a delay: two on each side, one where they are neighbouring samples, whose mean is as exact as
    samples are.

    Examples
    --------
    >>> from bondgraph.declare.effect import Scale
    >>> bus = Place(Handle("bus", "1", None), Scale(1.0, 1.0), times=(0.25, 20.0))
    >>> delays_at(bus)
    ([0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96], 0.25)
    >>> delays_at(replace(bus, near=(2.6, 0.5)))
    ([0, 6, 8, 10, 12, 14], 0.25)
    >>> delays_at(replace(bus, near=(2.6, 0.25)))
    ([0, 9, 10, 11], 0.25)
    """
    interval, (about, spacing) = float(f"{at.times[0]:.9g}"), at.near
    if spacing:
        apart = max(round(spacing / interval), 1)
        middle, reach = max(round(about / interval / apart), 1), _reach(apart)
        return [0, *(k * apart for k in range(max(middle - reach, 1), middle + reach + 1))], interval
    _, (_, longest) = lateness(at)
    doublings = range(math.ceil(math.log2(longest / interval)))
    return [0, 1, *(2**k * part for k in doublings for part in (2, 3))], interval


def _reach(apart: int) -> int:
    """How many delays, so many intervals apart, a law has on each side of the one in the middle."""
    return 2 if apart > 1 else 1


def closer_delay(at: Place, found: float) -> Place | None:
    """The place with delays closer to the one that was found; None where they are as close as samples tell.

    The spacing is a quarter of that before; the first is a quarter of the delay, whose neighbours are a third to a half
    of it apart. The place moves on where the delay ends beyond the neighbours of the one in the middle.

    Examples
    --------
    >>> from bondgraph.declare.effect import Scale
    >>> bus = Place(Handle("bus", "1", None), Scale(1.0, 1.0), times=(0.05, 20.0))
    >>> closer_delay(bus, 0.9).near, closer_delay(replace(bus, near=(0.9, 0.2)), 0.97).near
    ((0.9, 0.2), (0.97, 0.05))
    """
    shortest, (about, spacing) = at.times[0], at.near
    if spacing and spacing <= shortest:
        moved = abs(found - about) > 0.75 * spacing and found > spacing
        return replace(at, near=(found, spacing)) if moved else None
    quarter = (spacing or found) / 4.0
    finer = shortest * 2.0 ** max(math.floor(math.log2(max(quarter / shortest, 1.0))), 0)
    return replace(at, near=(found, finer))


def over(unit: str, other: str, power: int = 1) -> str:
    """A unit over a power of another; empty where one is not known."""
    if not unit or not other:
        return ""
    below = f"({other})" if re.search(r"\W", other) else other
    return f"{unit}/{below}" + (f"^{power}" if power > 1 else "")


def coefficient(
    g: BondGraph, at: Place, effect: str, meaning: str, unit: str, power: int, signed: bool = False
) -> tuple[str, Expr]:
    """A coefficient whose largest value makes the loss as large as twice the efforts at this place."""
    name = f"{effect}_{at.name}"
    limit = 2.0 * at.scale.effort / at.scale.flow**power
    lower = -limit if signed else 0.0
    return name, g.parameter(f"c_{name}", 0.0, unit, f"{meaning} at {at.label}", (lower, limit))


def conductance(g: BondGraph, at: Place, effect: str, meaning: str, unit: str, power: int) -> tuple[str, Expr]:
    """A coefficient whose largest value takes half of the flow at this place."""
    name = f"{effect}_{at.name}"
    limit = 0.5 * at.scale.flow / at.scale.effort**power
    return name, g.parameter(f"c_{name}", 0.0, unit, f"{meaning} at {at.label}", (0.0, limit))


def direction(g: BondGraph, at: Place, name: str) -> Expr:
    """The flow over which smoothed dry friction changes sign; its parameter is ``w_`` and the name."""
    meaning = "flow at which the friction reaches 76 %"
    return g.parameter(f"w_{name}", at.smoothing * at.scale.flow, flow_unit(at), meaning)


#: Law of a flow through an opening; the small number keeps its slope finite where the pressures are equal.
ROOT_LAW = "flow = c*x*(x^2 + 1e-6)^((n - 1)/2), x = effort/e"
#: Share of its largest pressure below which flow through an opening is laminar.
_LAMINAR = 1e-3
#: Powers of the pressure that drives flow through openings, from the root of a sharp edge to one of a laminar gap:
#: ASHRAE (2017), Handbook of Fundamentals, chapter 16, where cracks have 0.65.
_OPENINGS = (0.5, 1.0)


@dataclass(frozen=True)
class RootFlow:
    """A flow with the root of an effort: its law, and the names of its coefficient and of its power."""

    law: Callable[[Expr], Expr]
    coefficient: str
    power: str


def root_flow(g: BondGraph, at: Place, name: str) -> RootFlow:
    """A flow through an opening; its coefficient is the flow at the largest effort of the place.

    Below a small share of that effort it is laminar, which keeps its slope finite (Merritt 1967, section 3-4). Its
    power is that of a sharp edge, or another one where the logs ask for it.
    """
    flow, size = at.scale.flow, at.scale.effort
    c = g.parameter(f"c_{name}", 0.0, flow_unit(at), f"flow at {size:.3g} {effort_unit(at)}", (0.0, 0.5 * flow))
    at_most = g.parameter(f"e_{name}", size, effort_unit(at), "effort of that flow")
    n = g.parameter(f"n_{name}", _OPENINGS[0], "1", "power of the effort", _OPENINGS)

    def law(effort: Expr) -> Expr:
        x = effort / at_most
        return c * x * (x**2 + _LAMINAR**2) ** ((n - 1) / 2)

    return RootFlow(law, c.name, n.name)


def elements_at(g: BondGraph, at: Place, kind: str) -> list[Node]:
    """The one-ports of a kind at a junction."""
    flat = g.flatten()
    found = []
    for index, inward in flat.incidence()[at.junction.name]:
        bond = flat.bonds[index]
        node = flat.nodes[bond.source if inward else bond.target]
        if node.kind == kind and node.ports == 1:
            found.append(node)
    return found


def transmitted(g: BondGraph, at: Place) -> Expr | None:
    """The effort that a junction passes on through a two-port or a 0-junction, as a signal.

    That is the effort that arrives; at the head of a chain, where only a source drives, the one that leaves.
    """
    if not is_motion(at):
        return None
    flat = g.flatten()
    for index, _ in sorted(flat.incidence()[at.junction.name], key=lambda end: not end[1]):
        bond = flat.bonds[index]
        other = bond.target if bond.source == at.junction.name else bond.source
        if flat.nodes[other].kind == "0":
            return Handle(other, "0", at.domain).effort
        if flat.nodes[other].kind in ("TF", "GY"):
            port = 1 + [i for i, _ in flat.incidence()[other]].index(index)
            return signal("effort", other, port)
    return None


def commands(g: BondGraph, at: Place, node: Node) -> list[Input]:
    """The inputs, other than levers and switches, on which the laws of an element depend, through signals too.

    A lever or a switch has no unit, is held between samples, and takes few values: the place names those that do not. A
    held voltage is the command of a controller.
    """
    return [one for one in followed(g, node) if one.name in at.commands or not (one.is_held and one.unit in ("", "1"))]


def followed(g: BondGraph, node: Node) -> list[Input]:
    """All inputs on which the laws of an element depend, through signals too."""
    flat = g.flatten()
    named = {symbol(one.name): one.expression for one in flat.signals}
    reached: set[Symbol] = set()
    waiting = [used for _, law in node.laws for used in law.free_symbols]
    while waiting:
        used = waiting.pop()
        if used not in reached:
            reached.add(used)
            waiting += named[used].free_symbols if used in named else ()
    return [one for one in flat.inputs if one.symbol in reached]


def commanded(g: BondGraph, at: Place, kinds: Sequence[str], temperatures: bool = False) -> list[tuple[Node, Input]]:
    """Elements of some kinds at a junction that follow an input, each with the first such input.

    A transformer or gyrator belongs to the junction that its first bond comes from. A temperature that is given is no
    actuator's: it may arrive late (``temperatures``), as a feed does through a pipe, but has no range of its own.
    """
    kinds = [kind for kind in kinds if temperatures or kind != "Se" or at.domain != THERMAL]
    if at.bond is not None or at.junction.kind not in ("0", "1"):
        return []
    nodes = [
        node for kind in kinds for node in (driven_from(g, at, kind) if kind in TWO_PORTS else elements_at(g, at, kind))
    ]
    return [(node, inputs[0]) for node in nodes if (inputs := commands(g, at, node))]


def driven_from(g: BondGraph, at: Place, kind: str) -> list[Node]:
    """The transformers or gyrators whose first bond comes from a junction."""
    flat = g.flatten()
    ends = (flat.nodes[bond.target] for bond in flat.bonds if bond.source == at.junction.name)
    return [node for node in ends if node.kind == kind]


def gyrators_at(g: BondGraph, at: Place) -> list[Node]:
    """The gyrators at a junction, from whichever side they are bonded to it."""
    return two_ports_at(g, at, "GY")


def two_ports_at(g: BondGraph, at: Place, kind: str) -> list[Node]:
    """The transformers (``TF``) or gyrators at a junction, from whichever side they are bonded to it."""
    flat = g.flatten()
    ends = [flat.bonds[index] for index, _ in flat.incidence()[at.junction.name]]
    others = (flat.nodes[bond.target if bond.source == at.junction.name else bond.source] for bond in ends)
    return [node for node in others if node.kind == kind]


def yielding(g: BondGraph, at: Place) -> tuple[Node, Expr] | None:
    """The straight resistance that sets the flow of a junction without inertia, and its flow for each unit of effort.

    There the forces decide how fast something gives way; friction must hold them before it moves at all.
    """
    if not is_speed(at) or elements_at(g, at, "I"):
        return None
    found = elements_at(g, at, "R")
    if len(found) != 1:
        return None
    for gives, own in (("flow", "effort"), ("effort", "flow")):
        law = found[0].law(gives)
        slope = None if law is None else linear_coefficient(law, symbol(own))
        if slope is not None and not slope.has(symbol(own)) and gives_flow(g, found[0].name):
            return found[0], slope if gives == "flow" else 1 / slope
    return None


def gives_flow(g: BondGraph, resistance: str) -> bool:
    """Whether causality lets a resistance give a flow to its junction."""
    causal = assign_causality(g)
    own = next(k for k, bond in enumerate(causal.bonds) if resistance in (bond.source, bond.target))
    return causal.receives_effort(own, resistance)


def position_at(g: BondGraph, at: Place) -> tuple[Expr, str] | None:
    """The declared integral of the flow of a junction, and its unit."""
    if not is_speed(at):
        return None
    found = next((i for i in g.integrals if i.of == signal("flow", at.junction.name)), None)
    return None if found is None else (symbol(found.name), found.unit)


def joins_speeds(g: BondGraph, at: Place) -> bool:
    """Whether a bond rigidly joins two speeds, directly or through a transformer (then only its first bond counts)."""
    if at.bond is None or at.domain in (THERMAL, CHEMICAL):
        return False
    flat = g.flatten()
    first, second = (flat.nodes[end] for end in (at.bond.source, at.bond.target))
    if first.kind == "TF":
        before = next(bond.source for bond in flat.bonds if bond.target == first.name)
        return second.kind == "1" and flat.nodes[before].kind != "1"
    return first.kind == "1" and second.kind in ("1", "TF")


def delayed(g: BondGraph, name: str, given: Expr, delay: Expr, unit: str, initial: object) -> Expr:
    """The value ``given`` as it was a ``delay`` [s] ago, by two new states, the first of which begins at ``initial``.

    A delay is no finite number of states; it is the approximation of Pade with a numerator of first and a denominator
    of second order, which is right to the fourth power of frequency times delay. Where both make two it loses 13 % in
    size and 0.09 rad; two lags of half the delay lose 50 % and 0.43 rad. It passes no step at once, which one with
    two zeros would. An order more leaves a third of the error, but one Runge-Kutta step per sample is unstable with it
    below 1.5 samples of delay (with this one: below 0.9), and such a delay was not found.

    Examples
    --------
    >>> g = BondGraph("amplifier")
    >>> u, delay = g.input("u", "V"), g.parameter("T", 0.1, "s")
    >>> delayed(g, "u", u, delay, "V", 0.0)
    late_u - rising_u/3
    """
    late = g.integral(f"late_{name}", 0, unit, f"{name}, late and smooth", initial=initial)
    rising = g.integral(f"rising_{name}", lambda x: (6 * (given - late) - 4 * x) / delay, unit, f"rise over {delay}")
    revise_integral(g, late.name, rising / delay)
    return late - rising / 3
