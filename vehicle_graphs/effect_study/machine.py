"""The machine that a study of effects is made on, and what may be put into it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from bondgraph.build import build
from bondgraph.correct.loop import LoopSettings
from bondgraph.data.log import FloatArray
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.elements import Bond
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.sensors import SENSOR_FAULTS
from bondgraph.errors import OptionError, suggest
from bondgraph.simulate.model import Model
from bondgraph.simulate.quantities import ParameterInfo

#: Inputs (n_u, samples) of a drive, for a model and the times of its samples (samples,).
Excitation = Callable[[Model, FloatArray, np.random.Generator], FloatArray]


@dataclass(frozen=True)
class Kind:
    """An effect that may be put into a machine.

    Parameters
    ----------
    function
        Its effect function; a fault of a sensor is one too.
    place
        A junction, a bond as ``"a -> b"``, or the output that a faulty sensor shows.
    guess
        The first coefficient from which the one of a wanted size is searched; its sign is kept.
    ratios
        Further coefficients over the first.
    shapes
        Values of the parameters that shape its law.
    largest
        Size of the first coefficient beyond which it is no such effect any more.
    relatives
        Effect functions that come near it, by name.
    outside, in_part
        Whether it is also tried taken out of the dictionary, and acting in part of the data only.

    Examples
    --------
    >>> from bondgraph.effects import quadratic_loss
    >>> Kind(quadratic_loss, "body", 0.1).label
    'quadratic_loss at body'
    """

    function: EffectFunction
    place: str
    guess: float
    ratios: tuple[float, ...] = ()
    shapes: tuple[float, ...] = ()
    largest: float = math.inf
    relatives: tuple[str, ...] = ()
    outside: bool = False
    in_part: bool = False

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.function.__name__

    @property
    def is_fault(self) -> bool:
        """Whether it is a fault of a sensor."""
        return self.function in SENSOR_FAULTS

    @property
    def where(self) -> str:
        """Its place as a closed loop labels it."""
        return f"sensor {self.place}" if self.is_fault else self.place

    @property
    def label(self) -> str:
        """Effect and place as a closed loop labels them."""
        return f"{self.name} at {self.where}"


@dataclass(frozen=True)
class StudyMachine:
    """A machine, how it is driven and measured, and what may be missing in its declaration.

    Parameters
    ----------
    name
        What it is called on the command line.
    graph
        Its declaration: what the estimating side is given.
    functions
        The dictionary of effects that is tried.
    kinds, faults
        Missing effects, and faults of sensors.
    pairs, masking
        Two effects at once: that can be told apart, and of which one hides the other.
    noise, process
        Standard deviations of the sensors, and per sqrt(s) of what drives states that the inputs do not explain.
    excite
        How it is driven.
    scale
        Sizes of effort and flow that the true effects' laws are smoothed by.
    rate, seconds, train
        Samples per second, length of a log, and number of training logs; one more is held out.
    settle
        Seconds for which the first inputs are held before a log starts.
    method, substeps
        How the simulated truth is integrated, and steps between its samples: Runge-Kutta, or for stiff machines without
        process noise a stiff method.
    sizing
        Steps between samples with which the size of an effect is searched, which many runs ask for; None: as many.
    spread
        True values of the free parameters lie within this share of the declared ones.
    settings
        How the loop is closed.
    hidden
        Inputs of the drive that the logs do not have: they show their declared defaults.
    """

    name: str
    graph: Callable[[], BondGraph]
    functions: tuple[EffectFunction, ...]
    kinds: tuple[Kind, ...]
    faults: tuple[Kind, ...]
    pairs: tuple[tuple[Kind, Kind], ...]
    masking: tuple[tuple[Kind, Kind], ...]
    noise: Mapping[str, float]
    excite: Excitation
    scale: Scale
    rate: float
    seconds: float
    train: int
    settle: float
    substeps: int
    method: str = "rk4"
    sizing: int | None = None
    spread: float = 0.1
    process: Mapping[str, float] = field(default_factory=dict)
    settings: LoopSettings = field(default_factory=LoopSettings)
    hidden: tuple[str, ...] = ()

    def shortened(self, factor: float = 0.5) -> StudyMachine:
        """The same with shorter logs."""
        return replace(self, seconds=factor * self.seconds)

    def kind(self, label: str) -> Kind:
        """The kind of a label.

        Raises
        ------
        OptionError
            If there is none.
        """
        known = {kind.label: kind for kind in (*self.kinds, *self.faults)}
        known = {kind.label: kind for pair in (*self.pairs, *self.masking) for kind in pair} | known
        if label not in known:
            raise OptionError(f"{self.name}: no effect {label!r}{suggest(label, known)}", where=(label,))
        return known[label]

    def model(self, kinds: tuple[Kind, ...] = ()) -> tuple[Model, tuple[Effect, ...]]:
        """The model with effects, made once, and what they added."""
        return true_model(self.graph, self.scale, kinds)

    def free(self) -> tuple[ParameterInfo, ...]:
        """The parameters that the estimating side may move."""
        named, (model, _) = self.settings.free, self.model()
        return tuple(info for info in model.parameters if (info.name in named if named else info.lower is not None))

    def dictionary(self, without: tuple[str, ...] = ()) -> list[EffectFunction]:
        """The effect functions, some of them taken out."""
        return [function for function in self.functions if function.__name__ not in without]


@functools.lru_cache(maxsize=128)
def true_model(
    declared: Callable[[], BondGraph], scale: Scale, kinds: tuple[Kind, ...]
) -> tuple[Model, tuple[Effect, ...]]:
    """The model of a declared graph with these effects, and what they added.

    Raises
    ------
    OptionError
        If an effect makes no sense at its place.
    """
    graph = copy(declared())
    effects = []
    for kind in kinds:
        effect = kind.function(graph, _place(graph, scale, kind))
        if effect is None:
            raise OptionError(f"{kind.label}: makes no sense in {graph.name} - take another place", where=(kind.place,))
        effects.append(effect)
    return build(graph).model, tuple(effects)


def _place(graph: BondGraph, scale: Scale, kind: Kind) -> Place:
    if kind.is_fault:
        return Place.sensor(kind.place, scale)
    tail, arrow, head = kind.place.partition(" -> ")
    return Place(handle(graph, tail), scale, Bond(tail, head) if arrow else None)


def coefficient_values(kind: Kind, effect: Effect, first: float) -> dict[str, float]:
    """All parameters of an effect, given its first coefficient."""
    shares = (1.0, *kind.ratios)
    values = {name: share * first for name, share in zip(effect.coefficients, shares, strict=True)}
    return values | dict(zip(effect.shapes, kind.shapes, strict=True))
