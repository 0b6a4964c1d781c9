"""Inputs that a log lacks: given as constants, taken from the declaration, or refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bondgraph.coherent import Displayed
from bondgraph.data.log import Log, LogChannel
from bondgraph.data.signals import InputQuantity, Signals, names_of
from bondgraph.errors import DataError, OptionError, suggest
from bondgraph.text import inflected


def require_inputs(
    log: Log, model: Signals, channels: Mapping[str, LogChannel], given: Mapping[str, float | str]
) -> None:
    """Refuse a log that lacks inputs which nobody gives a value: zero would be an invention.

    Raises
    ------
    DataError
        If there are such inputs.
    OptionError
        If a value is given for what is no input.
    """
    inputs = {quantity.name: quantity for quantity in model.inputs}
    for name in given:
        if name not in inputs:
            raise OptionError(
                f"--set {name}: {model.name} has no input of this name{suggest(name, inputs)}", where=("--set", name)
            )
    lacking = [
        quantity
        for quantity in model.inputs
        if not quantity.has_default
        and quantity.name not in given
        and not quantity.rate_of
        and not quantity.late_of
        and (quantity.name not in channels or channels[quantity.name].missing.all())
    ]
    if lacking:
        first = lacking[0]
        named = ", ".join(f"{quantity.name!r} [{_unit(quantity)}]" for quantity in lacking)
        empty = told_empty([quantity.name for quantity in lacking], channels)
        sets = " ".join(f"--set {quantity.name}=0" for quantity in lacking)
        unused = [name for name in channels if name not in names_of(model)]
        raise DataError(
            f"{log.name}: no values for the {inflected(lacking, 'input', 'inputs')} {named} of {model.name}"
            f"{suggest(first.name, unused)}{empty} - map a column with --map column={first.name}, give a constant "
            f"with {sets}, or declare the input with a default; the columns are {', '.join(log.channels)}",
            where=(log.name, *(quantity.name for quantity in lacking)),
        )


def told_empty(names: Sequence[str], channels: Mapping[str, LogChannel]) -> str:
    """The words on those of these names whose columns are there, with no value in any row; none where there are none.

    Examples
    --------
    >>> import numpy as np
    >>> told_empty(["push", "speed"], {"speed": LogChannel("v", "m/s", np.array([np.nan]))})
    "; column 'v' is there, but empty"
    """
    empty = [channels[name].name for name in names if name in channels]
    if not empty:
        return ""
    named = f"{inflected(empty, 'column', 'columns')} {', '.join(map(repr, empty))}"
    return f"; {named} {inflected(empty, 'is', 'are')} there, but empty"


def lacking_input(quantity: InputQuantity, given: float | str | None) -> tuple[float, str]:
    """Value of an input that a log lacks, as given or else as declared, and the sentence that says so.

    Raises
    ------
    OptionError
        If a letter is given that the input does not know.
    """
    value = _constant(quantity.default if given is None else given, quantity, given is not None)
    shown = given if isinstance(given, str) else f"{value:g}"
    if isinstance(quantity, Displayed) and not isinstance(given, str):
        shown = f"{quantity.shown(value):g}"
    origin = "from the declaration" if given is None else "as given"
    return value, f"input {quantity.name!r} is not in the log; {shown} {_unit(quantity)} is taken {origin}"


def _unit(quantity: InputQuantity) -> str:
    return quantity.display_unit if isinstance(quantity, Displayed) else quantity.unit


def _constant(value: float | str, quantity: InputQuantity, is_given: bool) -> float:
    """The value of an input in coherent SI; a number that is given is one in the declared unit."""
    if not isinstance(value, str):
        return quantity.coherent(value) if is_given and isinstance(quantity, Displayed) else value
    letters = dict(quantity.letters or ())
    if value not in letters:
        raise OptionError(
            f"--set {quantity.name}={value}: the value must be a number"
            + (f" or one of {', '.join(letters)}" if letters else ""),
            where=("--set", quantity.name),
        )
    return letters[value]
