"""FMUs of any maker beside a model: simulated along the columns of a log, their outputs are channels of a log.

An FMU holds compiled code and no equations, so it has neither causal strokes nor derivatives and cannot stand inside a
graph. It stands beside one: a log feeds it, and what comes out feeds a source of a model or is compared with what was
measured. That is coupling one way. Two ways, the FMU would need the model's outputs at the very times for which it
gives the model's inputs: an algebraic loop through code that cannot be differentiated, repeated in each stage of each
step of the solver and of the filter, which no co-simulation FMU allows (it cannot go back in time). For that, export
the model (:func:`bondgraph.exchange.export_fmu`) and couple the two in a tool made for it.

An FMU is a program of its maker: it runs with the rights of whoever calls it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data.header import UNKNOWN_UNIT, is_unit
from bondgraph.data.log import FloatArray, Log, LogChannel, row_list
from bondgraph.data.matching import known_parameters, match_inputs, renamed
from bondgraph.errors import DataError, OptionError, suggest
from bondgraph.exchange.fmu_course import course_of, simulated
from bondgraph.exchange.fmu_variables import REAL, Fmu, FmuVariable, read_fmu
from bondgraph.text import few

#: Relative tolerance of the integration of a model-exchange FMU, per state: that of a simulation of a graph.
RTOL = 1e-9
#: Communication steps of a co-simulation FMU between two samples.
STEPS = 4


@dataclass(frozen=True)
class FmuRun:
    """Answer of an FMU to a log: a log of its outputs at the same times, and what deserves attention."""

    log: Log
    notes: tuple[str, ...]


def fmu_outputs(
    path: Path | str,
    log: Log,
    *,
    values: Mapping[str, float | str] | None = None,
    units: Mapping[str, str] | None = None,
    mapping: Mapping[str, str] | None = None,
    held: Collection[str] = (),
    kind: str | None = None,
    steps: int = STEPS,
    rtol: float = RTOL,
) -> Log:
    """Outputs of an FMU along the inputs of a log, as a log with the same times.

    Inputs that the FMU calls discrete, and those in ``held``, keep the value of a sample until the next one. All others
    run linearly in between: exactly so for model exchange; a co-simulation FMU, which sees its inputs at communication
    steps only, gets their value in the middle of each step (an error that falls with the square of the step, while an
    output that depends on an input directly lags by half a step).

    Parameters
    ----------
    path
        ``NAME.fmu``, FMI 1.0 to 3.0, with a binary for this machine.
    log
        A column for every input, called like it, in any unit of its dimension. A column called like a parameter that
        holds one value sets it.
    values
        Constant inputs, parameters and start values by name, in units of the FMU.
    units
        Units of variables for which the FMU itself has none.
    mapping
        Name of the column -> name in the FMU, where they differ.
    held
        Inputs that do not run linearly.
    kind
        ``"co-simulation"`` or ``"model-exchange"``; None: what the FMU is for, co-simulation where it is for both.
    steps
        Communication steps of a co-simulation FMU between samples.
    rtol
        Relative tolerance for model exchange.

    Returns
    -------
    Log
        Its channels are the outputs of the FMU in its units, ``?`` where it has none that is known.

    Raises
    ------
    ModelError
        If the file is no FMU, is not for this machine, or fails.
    DataError
        If the log lacks an input, has a unit of another dimension, or is uneven where the FMU asks for even steps.
    OptionError
        If a name is unknown, or the FMU is not of that kind.
    GenerationError
        If FMPy is not installed.

    References
    ----------
    Modelica Association, Functional Mock-up Interface 3.0 (2022), sections 3 and 4.

    Examples
    --------
    >>> import tempfile
    >>> from bondgraph.exchange import export_fmu
    >>> from bondgraph.simulate.example import pendulum
    >>> time = np.arange(0.0, 2.0, 0.05)
    >>> log = Log("push", time, {"drive": LogChannel("drive", "rad/s^2", np.sin(time))})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     fmu_outputs(export_fmu(pendulum(), f"{folder}/swing.fmu"), log, values={"length": 1.4})
    <Log push: 40 samples, 0 to 1.95 s; deflection [m]>
    """
    fmu = read_fmu(path)
    log = renamed(log, fmu, mapping or {})
    return run_fmu(
        with_units(fmu, units or {}, log), log, values=values, held=held, kind=kind, steps=steps, rtol=rtol
    ).log


def run_fmu(
    fmu: Fmu,
    log: Log,
    *,
    values: Mapping[str, float | str] | None = None,
    held: Collection[str] = (),
    kind: str | None = None,
    steps: int = STEPS,
    rtol: float = RTOL,
) -> FmuRun:
    """The same for an FMU that was read and whose variables have units (:func:`with_units`), with notes."""
    if len(log) < 2:
        raise DataError(f"{log.name}: one sample is no course of time along which an FMU can run", where=(log.name,))
    if steps < 1:
        raise OptionError(f"{steps} communication steps between samples: at least one is needed", where=(fmu.name,))
    chosen = _kind(fmu, kind)
    fmu = _holding(fmu, held)
    constants, starts = _given(fmu, values or {})
    parameters = {one.name: one for one in fmu.parameters}
    for name, value in known_parameters(log, fmu).items():
        starts.setdefault(name, _number(parameters[name], value))
    inputs = match_inputs(log, fmu, constants)
    rows = np.array([_number(one, row) for one, row in zip(fmu.inputs, inputs, strict=True)]).reshape(-1, len(log))
    _require_whole(fmu, log, rows)
    found = simulated(fmu, course_of(fmu, log, rows, chosen, steps), starts, chosen, rtol)
    channels = {
        one.name: LogChannel(one.name, one.unit, row * one.factor + one.offset)
        for one, row in zip(fmu.outputs, found, strict=True)
    }
    notes = [f"{fmu.path.name} departs from the standard: {fmu.problem}"] if fmu.problem else []
    notes += [f"outputs that a log cannot hold, text or arrays: {', '.join(fmu.left_out)}"] if fmu.left_out else []
    notes += [
        f"output {one.name!r} has no unit in the FMU that is known" for one in fmu.outputs if one.unit == UNKNOWN_UNIT
    ]
    return FmuRun(Log(log.name, log.time, channels, metadata={"fmu": fmu.name, "kind": chosen}), tuple(notes))


def _kind(fmu: Fmu, kind: str | None) -> str:
    if kind is not None and kind not in fmu.kinds:
        raise OptionError(f"{fmu.path}: the FMU is for {' and '.join(fmu.kinds)}, not {kind}", where=(kind,))
    return kind or fmu.kinds[0]


def _holding(fmu: Fmu, held: Collection[str]) -> Fmu:
    names = [one.name for one in fmu.inputs]
    for name in held:
        if name not in names:
            raise OptionError(
                f"{fmu.name} has no input {name!r} to hold{suggest(name, names)} - it has {', '.join(names)}",
                where=(name,),
            )
    inputs = (replace(one, interpolation="hold") if one.name in held else one for one in fmu.inputs)
    return replace(fmu, inputs=tuple(inputs))


def with_units(fmu: Fmu, given: Mapping[str, str], log: Log) -> Fmu:
    """The FMU with units that were given for variables that have none.

    Raises
    ------
    OptionError
        If a variable has a unit already, or there is no such variable or unit.
    DataError
        If the log feeds a variable that has no unit with a column that has one.
    """
    variables = {one.name: one for one in (*fmu.inputs, *fmu.parameters, *fmu.outputs)}
    for name, unit in given.items():
        if name not in variables:
            raise OptionError(
                f"a unit is given for {name!r}, which {fmu.name} does not have{suggest(name, variables)} - it has "
                f"{few(sorted(variables))}",
                where=(name,),
            )
        if not is_unit(unit) or variables[name].unit not in (UNKNOWN_UNIT, unit):
            problem = f"has the unit {variables[name].unit!r} in the FMU" if is_unit(unit) else "cannot have that unit"
            raise OptionError(f"{fmu.name}: {name!r} {problem}, and {unit!r} is given", where=(name, unit))
    fed = {one.name: log.channels[one.name] for one in (*fmu.inputs, *fmu.parameters) if one.name in log.channels}

    def known(one: FmuVariable) -> FmuVariable:
        if one.unit != UNKNOWN_UNIT:
            return one
        if one.name not in given and one.name in fed and not fed[one.name].is_text and fed[one.name].unit != "1":
            raise DataError(
                f"{log.name}: column {one.name!r} has unit {fed[one.name].unit!r}, but {fmu.name} does not say which "
                f"unit it takes - say it with units={{{one.name!r}: {fed[one.name].unit!r}}}, or --fmu-units "
                f"'{one.name}={fed[one.name].unit}' on the command line",
                where=(log.name, one.name),
            )
        return replace(one, unit=given.get(one.name, "1"))

    inputs, parameters = (tuple(known(one) for one in group) for group in (fmu.inputs, fmu.parameters))
    outputs = tuple(replace(one, unit=given.get(one.name, one.unit)) for one in fmu.outputs)
    return replace(fmu, inputs=inputs, parameters=parameters, outputs=outputs)


def _number(one: FmuVariable, value: Any) -> Any:
    """The number that the FMU takes for a value in the unit of a variable."""
    return (value - one.offset) / one.factor


def _given(fmu: Fmu, values: Mapping[str, float | str]) -> tuple[dict[str, float | str], dict[str, float]]:
    """Values given for inputs, and numbers at which other variables start."""
    inputs = {one.name for one in fmu.inputs}
    others = {one.name: one for one in (*fmu.settable, *fmu.parameters)}
    constants: dict[str, float | str] = {}
    starts: dict[str, float] = {}
    for name, value in values.items():
        if name in inputs:
            constants[name] = value
            continue
        if name not in others:
            known = {*inputs, *others}
            raise OptionError(
                f"{fmu.name} has no input, parameter or start value {name!r}{suggest(name, known)} - it has "
                f"{few(sorted(known))}",
                where=(name,),
            )
        letters = others[name].letters or {}
        if isinstance(value, str) and value not in letters:
            raise OptionError(
                f"{name}={value}: the value must be a number" + (f" or one of {', '.join(letters)}" if letters else ""),
                where=(name,),
            )
        starts[name] = letters[value] if isinstance(value, str) else float(_number(others[name], value))
    return constants, starts


def _require_whole(fmu: Fmu, log: Log, rows: FloatArray) -> None:
    for one, row in zip(fmu.inputs, rows, strict=True):
        broken = np.flatnonzero(row != np.round(row)) if one.kind not in REAL else np.zeros(0, dtype=int)
        if broken.size:
            raise DataError(
                f"{log.name}: column {one.name!r} has {row[broken[0]]:g} ({row_list(broken, log.first_row)}), but the "
                f"input of {fmu.name} is of type {one.kind}",
                where=(log.name, one.name),
            )
