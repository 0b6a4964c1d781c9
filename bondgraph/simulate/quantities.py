"""What a generated module says of its states, inputs, parameters and outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bondgraph.coherent import Displayed


@dataclass(frozen=True)
class StateInfo(Displayed):
    """One state: its unit and value at the start."""

    name: str
    unit: str
    initial: float
    meaning: str
    shown_unit: str = ""


@dataclass(frozen=True)
class StartInfo:
    """A state that starts, in a log, at ``factor`` times the first value of an input or of a measured output."""

    state: str
    signal: str
    factor: float


@dataclass(frozen=True)
class InputInfo(Displayed):
    """One input: its default, how it runs between samples, and its letters if it is a code.

    ``interpolation`` is ``linear``, ``hold``, ``band limited``, or ``rate of NAME`` for the slope of another input,
    which is held between samples. One that follows ``late_of`` so many seconds later runs as that one does.
    ``zero_default`` tells a default of zero that is declared from none at all.
    """

    name: str
    unit: str
    default: float
    interpolation: str
    letters: Mapping[str, float] | None
    meaning: str
    shown_unit: str = ""
    zero_default: bool = False
    late_of: str = ""
    late_by: float = 0.0

    @property
    def has_default(self) -> bool:
        """Whether a default is declared; what has none must be given."""
        return self.default != 0.0 or self.zero_default

    @property
    def rate_of(self) -> str:
        """The input whose slope this one is; empty for all others."""
        start = "rate of "
        return self.interpolation.removeprefix(start) if self.interpolation.startswith(start) else ""


@dataclass(frozen=True)
class ParameterInfo(Displayed):
    """One parameter: its value and its bounds; without bounds it was measured and stays fixed.

    ``tolerance`` is the share of its value by which it may be off, two standard deviations, where that is declared.
    """

    name: str
    unit: str
    value: float
    lower: float | None
    upper: float | None
    meaning: str
    shown_unit: str = ""
    tolerance: float | None = None


@dataclass(frozen=True)
class OutputInfo(Displayed):
    """One measured quantity."""

    name: str
    unit: str
    meaning: str
    shown_unit: str = ""
