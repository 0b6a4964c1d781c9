"""Bring a log into the order and units of a model.

Columns are matched to inputs, outputs and parameters by name, after a mapping for logs that use other names. Nothing is
dropped or invented in silence: what the model does not use and what the log does not hold is listed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from bondgraph.coherent import Displayed
from bondgraph.data.checks import Finding, check_log
from bondgraph.data.header import TEXT_UNIT, convert_unit
from bondgraph.data.lacking import lacking_input, require_inputs, told_empty
from bondgraph.data.log import FloatArray, Log, LogChannel, MatchedLog
from bondgraph.data.rates import slopes
from bondgraph.data.signals import InputQuantity, Quantity, Signals, names_of
from bondgraph.data.suspicions import time_gaps
from bondgraph.errors import DataError, OptionError, require_kind, suggest, wrong_kind


def match(
    log: Log,
    model: Signals,
    mapping: Mapping[str, str] | None = None,
    given: Mapping[str, float | str] | None = None,
) -> MatchedLog:
    """A log in the order and units of a model.

    Parameters
    ----------
    log
        As read.
    model
        Anything with ``inputs``, ``outputs`` and ``parameters``, such as a ``Model``.
    mapping
        Name of the column -> name in the model, where they differ (``read_mapping``).
    given
        Values (or letters) of inputs that the log lacks, by name in the model.

    Returns
    -------
    MatchedLog
        Inputs complete, shape (n_u, n); outputs NaN where not measured, shape (n_y, n); a column that is called like a
        parameter and holds one value sets that parameter for this log.

    Raises
    ------
    DataError
        If a unit has another dimension than the model's, a code is unknown, a column called like a parameter varies,
        the mapping names what does not exist, the log measures no output of the model, or it lacks an input that is
        neither given nor has a default.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = LogChannel("deflection", "mm", np.array([100.0, np.nan, 80.0]))
    >>> log = bg.match(bg.Log("swing", np.arange(3.0), {"deflection": swing}), pendulum(), given={"drive": 0.0})
    >>> log.y.tolist(), log.u.tolist()
    ([[0.1, nan, 0.08]], [[0.0, 0.0, 0.0]])
    """
    require_kind("match", log, Log, "log")
    if not all(hasattr(model, group) for group in ("inputs", "outputs", "parameters")):
        raise wrong_kind("match", model, "model")
    channels, renamed = _rename(log, model, mapping or {})
    _require_outputs(log, model, channels)
    notes = [finding.message for finding in check_log(log) if _matters(finding, renamed[finding.channel], model)]
    notes += time_gaps(log.time, log.first_row)
    notes += [
        f"no column {column!r} to map to {name!r}; the log has a column {name!r}, which is taken"
        for column, name in (mapping or {}).items()
        if column not in log.channels
    ]
    u = _inputs(log, channels, model, given or {}, notes)
    y = np.array([_output(log, channels, quantity, notes) for quantity in model.outputs]).reshape(-1, len(log))
    overrides = {
        quantity.name: _known_value(log, channels[quantity.name], quantity)
        for quantity in model.parameters
        if quantity.name in channels
    }
    unmatched = tuple(old for old, new in renamed.items() if new not in names_of(model))
    if unmatched:
        notes.append("columns the model does not use: " + ", ".join(unmatched))
    return MatchedLog(log.name, log.time, u, y, overrides, unmatched, tuple(notes))


def renamed(log: Log, model: Signals, mapping: Mapping[str, str]) -> Log:
    """A log whose columns are called as in the model.

    Raises
    ------
    DataError
        If the mapping names what the model or the log does not have, or two columns get the same name.
    """
    return replace(log, channels=_rename(log, model, mapping)[0])


def match_inputs(log: Log, model: Signals, given: Mapping[str, float | str] | None = None) -> FloatArray:
    """The inputs of a model as a log has them, shape (n_u, n); what it lacks is as ``given``, or has its default.

    Whatever else the log holds is left alone.

    Raises
    ------
    DataError
        If a unit has another dimension than the model's, or an input has no value.
    """
    return _inputs(log, log.channels, model, given or {}, [])


def known_parameters(log: Log, model: Signals) -> dict[str, float]:
    """The parameters that a log knows: columns called like them that hold one value.

    Raises
    ------
    DataError
        If such a column varies or has another dimension.
    """
    return {
        quantity.name: _known_value(log, log.channels[quantity.name], quantity)
        for quantity in model.parameters
        if quantity.name in log.channels
    }


def match_outputs(log: Log, model: Signals) -> FloatArray:
    """What a log measured of the outputs of a model, shape (n_y, n), NaN where it did not.

    Raises
    ------
    DataError
        If a unit has another dimension than the model's.
    """
    channels = dict(log.channels)
    return np.array([_output(log, channels, quantity, []) for quantity in model.outputs]).reshape(-1, len(log))


def match_recorded(log: Log, model: Signals) -> tuple[FloatArray, dict[str, float]]:
    """The inputs of a model (n_u, n) and the parameters that a log knows, whatever else it holds.

    Raises
    ------
    DataError
        If a unit has another dimension than the model's, a column called like a parameter varies, or an input has
        neither a column nor a default.
    """
    return _inputs(log, log.channels, model, {}, []), known_parameters(log, model)


def read_mapping(options: Iterable[str]) -> dict[str, str]:
    """A mapping from the options of a command.

    Parameters
    ----------
    options
        Each ``column=name`` or the name of a JSON file that holds an object of such pairs.

    Raises
    ------
    OptionError
        If an option is neither, or a column is mapped twice.

    Examples
    --------
    >>> read_mapping(["engine_rpm=engine_speed"])
    {'engine_rpm': 'engine_speed'}
    """
    mapping: dict[str, str] = {}
    for option in options:
        column, equals, name = (part.strip() for part in option.partition("="))
        if not equals and not option.endswith(".json"):
            raise OptionError(
                f"--map {option}: write it as column=name, such as engine_rpm=engine_speed, or name a JSON file",
                where=("--map", option),
            )
        for old, new in ({column: name} if equals else _mapping_file(Path(option))).items():
            if mapping.get(old, new) != new:
                raise OptionError(f"--map: column {old!r} is mapped to {mapping[old]!r} and to {new!r}", where=(old,))
            mapping[old] = new
    return mapping


def _mapping_file(path: Path) -> dict[str, str]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise OptionError(f"--map {path}: the file cannot be read ({error})", where=("--map", str(path))) from None
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content.values()):
        raise OptionError(
            f'--map {path}: the file must hold an object such as {{"engine_rpm": "engine_speed"}}',
            where=("--map", str(path)),
        )
    return content


def _matters(finding: Finding, name: str, model: Signals) -> bool:
    """True for a finding that is worth saying of the quantity: a pedal may rest at its stop, a known value is constant.

    An input that is held between samples is a command, which may be given for one sample alone.
    """
    given = next((quantity for quantity in model.inputs if quantity.name == name), None)
    if given is not None:
        return finding.kind != "saturation" and not (finding.kind == "spike" and given.interpolation == "hold")
    if name in (quantity.name for quantity in model.parameters):
        return finding.kind != "constant"
    return name in names_of(model)


def _rename(log: Log, model: Signals, mapping: Mapping[str, str]) -> tuple[dict[str, LogChannel], dict[str, str]]:
    """Channels by their names in the model, and new names by old names."""
    known = names_of(model)
    for column, name in mapping.items():
        if name not in known:
            raise DataError(
                f"{log.name}: column {column!r} is mapped to {name!r}, which {model.name} does not have"
                f"{suggest(name, known)} - it has {', '.join(known)}",
                where=(log.name, column, name),
            )
        if column not in log.channels and name not in log.channels:
            hint = suggest(column, log.channels)
            raise DataError(
                f"{log.name}: no column {column!r} to map to {name!r}{hint} - the columns are "
                + ", ".join(log.channels),
                where=(log.name, column),
            )
    renamed = {name: mapping.get(name, name) for name in log.channels}
    channels: dict[str, LogChannel] = {}
    for old, new in renamed.items():
        if new in channels:
            raise DataError(
                f"{log.name}: columns {channels[new].name!r} and {old!r} both give {new!r} - map one of them elsewhere",
                where=(log.name, old),
            )
        channels[new] = log.channels[old]
    return channels, renamed


def _require_outputs(log: Log, model: Signals, channels: Mapping[str, LogChannel]) -> None:
    outputs = [quantity.name for quantity in model.outputs]
    if outputs and not any(name in channels and not channels[name].missing.all() for name in outputs):
        other = [name for name in channels if name not in outputs]
        hint = next((text for name in outputs if (text := suggest(name, other))), "")
        raise DataError(
            f"{log.name}: none of the outputs of {model.name} ({', '.join(outputs)}) is measured{hint}"
            f"{told_empty(outputs, channels)} - the columns are {', '.join(channels)}; map them with --map column=name",
            where=(log.name, *outputs),
        )


def _inputs(
    log: Log,
    channels: Mapping[str, LogChannel],
    model: Signals,
    given: Mapping[str, float | str],
    notes: list[str],
) -> FloatArray:
    """Inputs (n_u, n), none late; what the log lacks is a slope of what it holds, is given, or has its default."""
    require_inputs(log, model, channels, given)
    rows: dict[str, FloatArray] = {}
    late = {quantity.name for quantity in model.inputs if quantity.late_of}
    for quantity in model.inputs:
        if quantity.name in late or quantity.rate_of in late:  # they follow from the others
            continue
        channel = channels.get(quantity.name)
        if quantity.rate_of and (channel is None or channel.missing.all()):
            rows[quantity.name] = slopes(log.time, rows[quantity.rate_of])
            notes.append(f"input {quantity.name!r} is taken from the slope of {quantity.rate_of!r}")
        else:
            rows[quantity.name] = _input(log, channels, quantity, given.get(quantity.name), notes)
    return np.array(list(rows.values())).reshape(-1, len(log))


def _input(
    log: Log,
    channels: Mapping[str, LogChannel],
    quantity: InputQuantity,
    given: float | str | None,
    notes: list[str],
) -> FloatArray:
    channel = channels.get(quantity.name)
    if channel is None or channel.missing.all():
        value, note = lacking_input(quantity, given)
        notes.append(note)
        return np.full(len(log), value)
    if given is not None:
        notes.append(f"input {quantity.name!r} is in the log; the value {given} given for it is not used")
    letters = dict(quantity.letters or ())
    values = _coded(log, channel, letters) if letters else _converted(log, channel, quantity)
    missing = np.isnan(values)
    if missing.any():
        way = "held" if letters or quantity.interpolation == "hold" or quantity.rate_of else "interpolated"
        notes.append(f"input {quantity.name!r} is {way} over {int(missing.sum())} of {len(log)} samples")
        values = _filled(log.time, values, held=way == "held")
    return values


def _shown(quantity: InputQuantity) -> str:
    """The default of an input in the unit in which it was declared."""
    if isinstance(quantity, Displayed):
        return f"{quantity.shown(quantity.default):g} {quantity.display_unit}"
    return f"{quantity.default:g} {quantity.unit}"


def _filled(time: FloatArray, values: FloatArray, held: bool) -> FloatArray:
    """An input between its samples, as it is declared to run; before the first sample it has the first value."""
    valid = np.flatnonzero(~np.isnan(values))
    if not held:
        return np.interp(time, time[valid], values[valid])
    latest = np.searchsorted(valid, np.arange(time.size), side="right") - 1
    return values[valid[np.maximum(latest, 0)]]


def _output(log: Log, channels: Mapping[str, LogChannel], quantity: Quantity, notes: list[str]) -> FloatArray:
    channel = channels.get(quantity.name)
    if channel is None:
        notes.append(f"output {quantity.name!r} is not in the log; it counts as not measured")
        return np.full(len(log), np.nan)
    return _converted(log, channel, quantity)


def _converted(log: Log, channel: LogChannel, quantity: Quantity) -> FloatArray:
    if channel.unit == TEXT_UNIT or channel.is_text:
        first = int(np.argmax(~channel.missing))
        raise DataError(
            f"{log.name}: column {channel.name!r} holds codes such as {str(channel.values[first])!r} "
            f"(row {first + log.first_row}) but {quantity.name!r} is a number in {quantity.unit}",
            where=(log.name, channel.name),
        )
    factor, offset = convert_unit(channel.name, channel.unit, quantity.unit, log.name)
    return channel.numbers * factor + offset


def _coded(log: Log, channel: LogChannel, letters: Mapping[str, float]) -> FloatArray:
    """Values of a code signal; numbers are taken as codes where they all are, else as values."""
    cells, place = np.unique(channel.values[~channel.missing], return_inverse=True)
    codes = [str(cell) if channel.is_text else f"{cell:g}" for cell in cells]
    if not channel.is_text and not all(code in letters for code in codes):
        return channel.numbers.copy()
    values = np.full(len(log), np.nan)
    values[~channel.missing] = np.array([letters.get(code, np.inf) for code in codes])[place]
    unknown = np.flatnonzero(np.isinf(values))
    if unknown.size:
        first = int(unknown[0])
        raise DataError(
            f"{log.name}: column {channel.name!r} has {str(channel.values[first])!r} (row {first + log.first_row})"
            f"{suggest(str(channel.values[first]), letters)} - the model knows {', '.join(letters)}",
            where=(log.name, channel.name),
        )
    return values


def _known_value(log: Log, channel: LogChannel, quantity: Quantity) -> float:
    values = _converted(log, channel, quantity)
    values = values[~np.isnan(values)]
    if values.size == 0:
        raise DataError(
            f"{log.name}: column {channel.name!r} sets parameter {quantity.name!r} but is empty - fill or drop it",
            where=(log.name, channel.name),
        )
    lowest, highest = float(values.min()), float(values.max())
    if highest - lowest > 1e-9 * max(abs(lowest), abs(highest)):
        raise DataError(
            f"{log.name}: column {channel.name!r} sets parameter {quantity.name!r}, which is one value per log, but "
            f"varies from {lowest:.6g} to {highest:.6g} {quantity.unit} - declare an input for it, or split the log",
            where=(log.name, channel.name),
        )
    return float(values[0])
