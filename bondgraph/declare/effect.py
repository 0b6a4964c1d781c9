"""Effects: physics that a graph lacks, as functions that extend it.

An effect function takes a graph and a place, adds the elements of its law with their parameters, and says what it
added; where it makes no physical sense it returns None and leaves the graph alone. There is no registry: any public
function of a module with the signature ``(BondGraph, Place) -> Effect | None`` is a candidate.

The coefficients of an effect are parameters whose value is zero when it is added: with all of them zero the graph
behaves as before, so that a candidate can be tested before it is believed. Parameters that shape its law but mean
nothing while it is absent (a Stribeck speed, a warm-up time) are named as ``shapes``; they are tried at several values
and then estimated. A law that is not smooth at zero (a backlash) names the ``amplitudes`` at which it is tried. An
effect that brings a storage of its own, or a delay (``adds_state``), cannot vanish in this way; it is tried by
refitting.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import get_type_hints

from bondgraph.declare.domains import Domain
from bondgraph.declare.elements import Bond
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.errors import DeclarationError
from bondgraph.files import check_name

#: The flow, as a share of its scale, at which smoothed dry friction reaches 76 % of its level.
SMOOTHING = 0.02
#: Times that logs can tell where nothing is known of them [s]: those of a minute and a half at 100 samples per second.
TIMES = (0.01, 100.0)


@dataclass(frozen=True)
class Scale:
    """How large effort and flow are at a place, in SI units; coefficients take their bounds from it."""

    effort: float
    flow: float


@dataclass(frozen=True)
class Place:
    """Where an effect may be added: a junction, a bond (then ``junction`` is its tail), two junctions, or a sensor.

    Two junctions of one kind and domain, between which something may leak or rub, are ``junction`` and ``other``; then
    the scale holds the difference of what they have in common, efforts or flows, and ``bond`` is none of the graph's.
    A sensor is named by ``output``; its ``junction`` is then no node, and its scale holds the size of what it shows
    (``effort``) and how far that moves from its mean (``flow``), both in the sensor's unit. Laws that turn round with
    the flow are smoothed over a share ``smoothing`` of its scale, which explicit integration needs. Laws with a time of
    their own look for it within ``times``: that between samples, and the length of the longest log, in s. Of
    ``near`` the first number is a time about which a law has a spacing, the second; zeros: it looks everywhere.
    ``commands`` names inputs without a unit, held between samples, that take more values than a lever has positions:
    the travel of a valve, a duty cycle.
    """

    junction: Handle
    scale: Scale
    bond: Bond | None = None
    output: str = ""
    smoothing: float = SMOOTHING
    other: Handle | None = None
    times: tuple[float, float] = TIMES
    near: tuple[float, float] = (0.0, 0.0)
    commands: frozenset[str] = frozenset()

    @classmethod
    def between(cls, first: Handle, second: Handle, scale: Scale, smoothing: float = SMOOTHING) -> Place:
        """Two junctions of one kind and domain.

        Examples
        --------
        >>> Place.between(Handle("a", "0", None), Handle("b", "0", None), Scale(1e5, 1e-4)).label
        'a and b'
        """
        return cls(first, scale, Bond(first.name, second.name), smoothing=smoothing, other=second)

    @classmethod
    def sensor(cls, output: str, scale: Scale) -> Place:
        """The sensor of an output.

        Examples
        --------
        >>> Place.sensor("speed", Scale(12.0, 4.0)).label
        'sensor speed'
        """
        return cls(Handle(output, "output", None), scale, None, output)

    @property
    def name(self) -> str:
        """Name of the junction or sensor, or ``a_b`` for the bond a -> b; dots of parts become underscores."""
        name = self.junction.name if self.bond is None else f"{self.bond.source}_{self.bond.target}"
        return name.replace(".", "_")

    @property
    def label(self) -> str:
        """The place as a person reads it."""
        if self.output:
            return f"sensor {self.output}"
        if self.other is not None:
            return f"{self.junction.name} and {self.other.name}"
        return self.junction.name if self.bond is None else str(self.bond)

    @property
    def domain(self) -> Domain | None:
        """The energy domain there, None where it is not declared."""
        return self.junction.domain


@dataclass(frozen=True)
class Effect:
    """What an effect function added.

    ``name`` is the kind of effect, ``element`` the added (or changed) element, ``law`` its law as text,
    ``coefficients`` the parameters that are zero when the effect is absent, ``shapes`` parameters that shape its law
    and are estimated with them. ``amplitudes`` are shares of the first coefficient's largest value at which a law
    that is not smooth at zero is tried. ``adds_state``: the effect brings a storage of its own and cannot vanish.
    ``widths`` are parameters that only smooth or bend the law, flows over which it changes its sign, an exponent with
    bounds: they keep their values unless the logs ask for others. ``dissipative``: a positive coefficient takes energy
    out of the machine, so that a negative one is no such law.
    ``regime`` says where it acts, in words; empty: everywhere.
    ``grids`` holds the values at which shapes are tried that are tried at values of their own, such as whole numbers.
    ``reference`` says where the law comes from, ``manoeuvre`` what shows it in a log. A fault of a sensor names its
    ``channel`` and ``kind``.

    ``closer`` gives the place at which the same effect function has a finer spacing about a value of the first
    coefficient, None where it is as fine as it gets; the law is found again there.

    The bounds of a coefficient scale the search for it, and are widened where that ends on one; only zero is kept.
    """

    name: str
    element: str
    law: str
    coefficients: tuple[str, ...]
    adds_state: bool = False
    shapes: tuple[str, ...] = ()
    amplitudes: tuple[float, ...] = ()
    reference: str = ""
    channel: str = ""
    kind: str = ""
    dissipative: bool = False
    widths: tuple[str, ...] = ()
    manoeuvre: str = ""
    grids: tuple[tuple[str, tuple[float, ...]], ...] = ()
    formula: bool = False
    regime: str = ""
    closer: Callable[[float], Place | None] | None = None

    def __post_init__(self) -> None:
        check_name(self.name, lambda problem: DeclarationError(f"effect: {problem}", where=(self.name,)))

    @property
    def described(self) -> str:
        """Its name, and where it acts if that is not everywhere.

        Examples
        --------
        >>> Effect("leakage", "leak", "flow = c*effort", ("c",), regime="pressure of tank is above a level").described
        'leakage where pressure of tank is above a level'
        """
        return f"{self.name} where {self.regime}" if self.regime else self.name

    @property
    def parameters(self) -> tuple[str, ...]:
        """Everything that is estimated with the effect: coefficients, then shapes."""
        return (*self.coefficients, *self.shapes)


EffectFunction = Callable[[BondGraph, Place], Effect | None]

#: Module of the effect functions that are tried where none are named.
EFFECTS = "bondgraph.effects"


def is_shipped(function: EffectFunction) -> bool:
    """True for an effect function of the toolkit, and not a user's own."""
    return function.__module__.startswith(EFFECTS)


def sensor_fault(function: EffectFunction) -> EffectFunction:
    """Mark an effect function as one for sensors: it is offered every measured output, and no junction or bond."""
    function.__dict__["for_sensors"] = True
    return function


def between_junctions(function: EffectFunction) -> EffectFunction:
    """Mark an effect function as one between two junctions: it is offered every such pair, and nothing else."""
    function.__dict__["for_pairs"] = True
    return function


#: Maker of the members of a family for a graph, from the typical sizes of its inputs that vary.
Members = Callable[[BondGraph, Mapping[str, float]], Sequence[EffectFunction]]


def family(members: Members) -> Callable[[EffectFunction], EffectFunction]:
    """Mark an effect function as one of a family of laws, such as one for each input; a loop tries all members."""

    def marked(function: EffectFunction) -> EffectFunction:
        function.__dict__["family"] = members
        return function

    return marked


def members_of(function: EffectFunction, graph: BondGraph, typical: Mapping[str, float]) -> Sequence[EffectFunction]:
    """The members of the family of an effect function, or itself alone; ``typical`` are sizes of inputs that vary.

    Examples
    --------
    >>> def no_effect(graph: BondGraph, place: Place) -> Effect | None: ...
    >>> members_of(no_effect, BondGraph("sled"), {}) == (no_effect,)
    True
    """
    found: Members | None = getattr(function, "family", None)
    return (function,) if found is None else found(graph, typical)


def is_for(function: EffectFunction, place: Place) -> bool:
    """Whether an effect function is to be offered a place."""
    for_sensors, for_pairs = (getattr(function, mark, False) for mark in ("for_sensors", "for_pairs"))
    return (bool(place.output), place.other is not None) == (for_sensors, for_pairs)


def effect_functions(module: ModuleType) -> tuple[EffectFunction, ...]:
    """The effect functions of a module or of the modules of a package, in order of definition or import.

    A module that defines none offers those that it imports; one that has ``__all__`` offers what that lists.

    Examples
    --------
    >>> import types
    >>> module = types.ModuleType("effects")
    >>> def no_effect(graph: BondGraph, place: Place) -> Effect | None: ...
    >>> no_effect.__module__ = "effects"
    >>> module.no_effect = no_effect
    >>> [function.__name__ for function in effect_functions(module)]
    ['no_effect']
    """
    names = getattr(module, "__all__", [name for name in vars(module) if not name.startswith("_")])
    public = [one for name in names if inspect.isfunction(one := getattr(module, name, None))]
    own = tuple(one for one in public if _defined_in(module, one) and is_effect_function(one))
    return own or tuple(filter(is_effect_function, public))


@functools.cache
def is_effect_function(function: Callable[..., object]) -> bool:
    """Whether a function says that it takes a graph and a place and returns an effect or None."""
    hints = get_type_hints(function, getattr(function, "__globals__", {}) | globals())
    return hints.get("return") == Effect | None and len(inspect.signature(function).parameters) == 2


def _defined_in(module: ModuleType, function: Callable[..., object]) -> bool:
    """Whether a function is the module's own, or that of a module of the package."""
    own = function.__module__ == module.__name__
    return own or (hasattr(module, "__path__") and function.__module__.startswith(f"{module.__name__}."))
