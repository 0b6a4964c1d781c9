"""Errors of the toolkit: where it happened, what is wrong, what to do.

Every message reads ``where: what is wrong, with which values - what to do`` in the user's own names. Library code
raises these; inside numerics a failure is a value (an ``Outcome``) so that one diverging member does not stop a swarm.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import TypeVar

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


class NotKeptError(OptionError, AttributeError):
    """A result that was read from a file lacks what only the program that made it had."""


#: A kind of thing of which one or several are given.
_Kind = TypeVar("_Kind")

#: Advice by the kind of thing that a verb of the front door asks for.
_GIVEN_BY = {
    "model": "bg.build(graph) or bg.load(file) gives one",
    "filter model": "bg.FilterModel(model, ...) gives one",
    "linear model": "bg.linearise(model, x={...}) gives one",
    "graph": "give a bg.BondGraph or its file",
    "log": "bg.read_log(file) or bg.Log.from_dataframe(table) gives one",
    "posed problem": "bg.pose(filter_model, logs, free) gives one",
    "finished estimate": "bg.estimate(model, logs) gives one",
    "prior": "give Normal, LogNormal, Uniform or MultivariateNormal of bondgraph.estimate, or fit.as_prior()",
    "loss": "give bg.Robust('student'), or its text 'student', 'huber' or 'gate'",
    "tie": "give expressions by name, {'k_r': '1.2*k_f'}",
    "data frame": "give one of pandas",
    "file": "give its name",
    "name": "give its text",
}


def require_kind(verb: str, given: object, kinds: type | tuple[type, ...], wanted: str) -> None:
    """Refuse a thing of another kind than a verb asks for, with what gives one of that kind.

    Raises
    ------
    OptionError
        If it is none of ``kinds``.

    Examples
    --------
    >>> require_kind("draw", 3, str, "graph")
    Traceback (most recent call last):
        ...
    bondgraph.errors.OptionError: draw: int was given where a graph is expected - give a bg.BondGraph or its file
    """
    if not isinstance(given, kinds):
        raise wrong_kind(verb, given, wanted)


def wrong_kind(verb: str, given: object, wanted: str) -> OptionError:
    """The error of a thing of another kind than a verb asks for, to be raised.

    Examples
    --------
    >>> wrong_kind("build", suggest, "graph").message
    'build: the function suggest was given where a graph is expected - call it: suggest()'
    """
    kind = type(given).__name__
    name = getattr(given, "__name__", "")
    if kind == "function" and wanted == "graph":
        told, remedy = f"the function {name}", f"call it: {name}()"
    else:
        told, remedy = kind, _GIVEN_BY[wanted]
    return OptionError(f"{verb}: {told} was given where a {wanted} is expected - {remedy}", where=(verb, kind))


def listed(verb: str, given: _Kind | Iterable[_Kind], kind: type[_Kind], wanted: str) -> list[_Kind]:
    """One thing, or several, as a list of things of one kind.

    Raises
    ------
    OptionError
        If something is of another kind.

    Examples
    --------
    >>> listed("ties", 1.5, float, "tie"), listed("ties", (), float, "tie")
    ([1.5], [])
    """
    if isinstance(given, kind):
        return [given]
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise wrong_kind(verb, given, wanted)
    found = list(given)
    for one in found:
        require_kind(verb, one, kind, wanted)
    return found


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
