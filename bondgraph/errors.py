"""Errors of the toolkit: where it happened, what is wrong, what to do.

Every message reads ``where: what is wrong, with which values - what to do`` in the user's own names. Library code
raises these; inside numerics a failure is a value (an ``Outcome``) so that one diverging member does not stop a swarm.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

#: A word of a message that is no name of anything: it is cut.
_ENDLESS = re.compile(r"\S{500,}")


class BondGraphError(Exception):
    """Base of all errors a user can cause.

    Parameters
    ----------
    message
        One readable message: where, what, what to do.
    where
        Names of the elements, bonds, columns or options concerned, for programs that read the error.

    Examples
    --------
    >>> error = DeclarationError("mixed: bond a -> b joins rotation and translation", where=("bond a -> b",))
    >>> error.where
    ('bond a -> b',)
    """

    def __init__(self, message: str, where: Iterable[str] = ()) -> None:
        super().__init__(_ENDLESS.sub(lambda word: f"{word[0][:100]}...", message))
        self.where: tuple[str, ...] = tuple(where)

    @property
    def message(self) -> str:
        """The message alone."""
        return str(self.args[0])


class DeclarationError(BondGraphError):
    """A graph is declared wrongly: unknown name, bad unit, impossible bond."""


class LawError(DeclarationError):
    """A law is no expression: its function fails on symbols, or gives something else."""


class CausalityError(BondGraphError):
    """No consistent assignment of causal strokes exists."""


class DerivationError(BondGraphError):
    """The graph is causal but its equations cannot be brought into state-space form."""


class DimensionError(BondGraphError):
    """A derived equation is not dimensionally homogeneous."""


class GenerationError(BondGraphError):
    """A module cannot be rendered or has drifted from its graph."""


class ModelError(BondGraphError):
    """A generated module cannot be loaded, or is called with names or shapes it does not have."""


class DataError(BondGraphError):
    """A measured log is not what a log must be."""


class FilterError(BondGraphError):
    """A filter model is declared wrongly."""


class EstimationError(BondGraphError):
    """An estimation problem is posed wrongly."""


class ExecutionError(BondGraphError):
    """Those who should compute are not there: a cluster does not answer, a worker died."""


class OptionError(BondGraphError):
    """A command was given options that are unknown or contradict each other."""


def suggest(name: str, known: Iterable[str]) -> str:
    """A close-match hint for an unknown name, empty where nothing is close.

    Examples
    --------
    >>> suggest("engine_sped", ["engine_speed", "brake"])
    "; did you mean 'engine_speed'?"
    >>> suggest("zzz", ["engine_speed"])
    ''
    """
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else ""
