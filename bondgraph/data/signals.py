"""What bringing a log into the order of a model needs to know of that model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol


class Quantity(Protocol):
    """Name and unit of anything a model declares."""

    @property
    def name(self) -> str:
        """Name as declared."""

    @property
    def unit(self) -> str:
        """SI unit as declared."""


class InputQuantity(Quantity, Protocol):
    """An input: its default and how it runs between samples."""

    @property
    def default(self) -> float:
        """Value where no log gives one."""

    @property
    def has_default(self) -> bool:
        """Whether that value was declared; otherwise a log must give one."""

    @property
    def interpolation(self) -> str:
        """How it runs between samples: ``linear``, ``hold``, ``band limited``, or held as the rate of another."""

    @property
    def rate_of(self) -> str:
        """The input, earlier in the list, whose slope this one is; empty for all others."""

    @property
    def late_of(self) -> str:
        """The input that this one follows later; empty for all others."""

    @property
    def letters(self) -> Mapping[str, float] | Sequence[tuple[str, float]] | None:
        """Values of codes, if any."""


class Signals(Protocol):
    """What matching needs to know of a model."""

    @property
    def name(self) -> str:
        """Name of the model."""

    @property
    def inputs(self) -> Sequence[InputQuantity]:
        """Inputs in the order of ``u``."""

    @property
    def parameters(self) -> Sequence[Quantity]:
        """Parameters in the order of ``theta``."""

    @property
    def outputs(self) -> Sequence[Quantity]:
        """Outputs in the order of ``y``."""


def names_of(model: Signals) -> list[str]:
    """Names of all inputs, outputs and parameters of a model."""
    return [quantity.name for group in (model.inputs, model.outputs, model.parameters) for quantity in group]
