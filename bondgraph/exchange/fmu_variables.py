"""The variables of an FMU of any maker as quantities with units, to which the columns of a log are matched."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bondgraph import units
from bondgraph.data.header import UNKNOWN_UNIT, is_unit
from bondgraph.errors import DeclarationError, ModelError
from bondgraph.exchange.libraries import library
from bondgraph.text import few

#: Types of the standards whose values are real numbers; only these run between samples and have units.
REAL = ("Real", "Float64", "Float32")
#: Types that a log cannot hold.
_NO_NUMBER = ("String", "Binary", "Clock")
#: Errors of files that are no FMUs.
_NO_ARCHIVE = (OSError, zipfile.BadZipFile, KeyError)
#: Relative difference of two factors of one conversion that comes from the digits in which they are written.
_DIGITS = 1e-6


@dataclass(frozen=True)
class FmuVariable:
    """An input, parameter or output of an FMU, as a log sees it.

    ``unit`` is ``?`` where the FMU has none that is known. The number that the FMU takes or gives is
    ``(value - offset) / factor`` of the value in that unit; both differ from 1 and 0 where the FMU writes a unit that
    the units library does not know, and says how it follows from SI units. ``letters`` are values of an enumeration.
    """

    name: str
    kind: str
    unit: str
    meaning: str = ""
    default: float = 0.0
    has_default: bool = False
    interpolation: str = "linear"
    rate_of: str = ""
    late_of: str = ""
    letters: Mapping[str, float] | None = None
    factor: float = 1.0
    offset: float = 0.0
    reference: int = 0


@dataclass(frozen=True, repr=False)
class Fmu:
    """Description of an FMU by itself: ``kinds`` it can be run as, inputs, parameters and outputs.

    ``settable`` are all variables with a start value, ``left_out`` outputs that a log cannot hold: text and arrays.
    ``problem`` says where the description departs from the standard.
    """

    path: Path
    name: str
    version: str
    kinds: tuple[str, ...]
    inputs: tuple[FmuVariable, ...]
    parameters: tuple[FmuVariable, ...]
    outputs: tuple[FmuVariable, ...]
    settable: tuple[FmuVariable, ...]
    left_out: tuple[str, ...] = ()
    problem: str = ""
    described: Any = field(default=None, compare=False)

    def __repr__(self) -> str:
        listed = ", ".join(f"{one.name} [{one.unit}]" for one in self.inputs)
        given = few([f"{one.name} [{one.unit}]" for one in self.outputs])
        return f"<Fmu {self.name}: FMI {self.version}, {' or '.join(self.kinds)}; {listed} -> {given}>"


def read_fmu(path: Path | str) -> Fmu:
    """The variables of an FMU; nothing of it runs.

    Parameters
    ----------
    path
        ``NAME.fmu`` of FMI 1.0, 2.0 or 3.0.

    Raises
    ------
    ModelError
        If there is no such file, it is no FMU, or it is neither for co-simulation nor for model exchange.
    GenerationError
        If FMPy is not installed.

    Examples
    --------
    >>> import tempfile
    >>> from bondgraph.exchange import export_fmu
    >>> from bondgraph.simulate.example import pendulum
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     read_fmu(export_fmu(pendulum(), f"{folder}/swing.fmu"))
    <Fmu pendulum: FMI 2.0, model-exchange; drive [rad/s^2] -> deflection [m]>
    """
    path = Path(path)
    if not path.is_file():
        raise ModelError(f"{path}: no such file - give an FMU, NAME.fmu", where=(str(path),))
    fmpy = library("fmpy", "fmu")
    problem = ""
    try:
        try:
            described = fmpy.read_model_description(str(path))
        except _NO_ARCHIVE:
            raise
        except Exception as error:  # descriptions of many makers lack what the standard asks for, and run all the same
            problem = said(error)
            described = fmpy.read_model_description(str(path), validate=False)
    except _NO_ARCHIVE as error:
        raise ModelError(
            f"{path}: not an FMU, which is an archive with a file modelDescription.xml ({said(error)})",
            where=(str(path),),
        ) from None
    except Exception:  # FMPy and its reader of XML raise many kinds
        raise ModelError(f"{path}: the description of the FMU cannot be read: {problem}", where=(str(path),)) from None
    return _fmu(path, described, problem)


def _fmu(path: Path, described: Any, problem: str) -> Fmu:
    kinds = {"co-simulation": described.coSimulation, "model-exchange": described.modelExchange}
    found = tuple(kind for kind, section in kinds.items() if section is not None)
    if not found:
        raise ModelError(f"{path}: the FMU is neither for co-simulation nor for model exchange", where=(str(path),))
    definitions = {one.name: one for one in described.unitDefinitions}
    listed = [one for one in described.modelVariables if one.causality != "independent"]
    held = [one for one in listed if not (one.type in _NO_NUMBER or one.dimensions)]
    for one in listed:
        if one.causality == "input" and one not in held and one.type != "Clock":
            raise ModelError(
                f"{path}: input {one.name!r} is an array or text; columns of a log feed single numbers",
                where=(str(path), one.name),
            )
    variables = {one.name: _variable(one, definitions) for one in held}
    by_cause = {
        cause: tuple(variables[one.name] for one in held if one.causality == cause)
        for cause in ("input", "parameter", "output")
    }
    return Fmu(
        path, described.modelName, described.fmiVersion, found, by_cause["input"], by_cause["parameter"],
        by_cause["output"], tuple(variables[one.name] for one in held if one.start is not None),
        tuple(one.name for one in listed if one.causality == "output" and one not in held), problem, described,
    )  # fmt: skip


def _variable(one: Any, definitions: Mapping[str, Any]) -> FmuVariable:
    if one.type not in REAL:
        return FmuVariable(
            one.name, one.type, "1", one.description or "", interpolation="hold", letters=_letters(one),
            reference=one.valueReference,
        )  # fmt: skip
    written = one.unit or (one.declaredType.unit if one.declaredType is not None else None)
    unit, factor, offset = _unit(written, definitions.get(written or ""))
    way = "linear" if one.variability in (None, "continuous") else "hold"
    return FmuVariable(
        one.name, one.type, unit, one.description or "", interpolation=way, factor=factor, offset=offset,
        reference=one.valueReference,
    )  # fmt: skip


def _letters(one: Any) -> dict[str, float] | None:
    if one.type == "Boolean":
        return {"false": 0.0, "true": 1.0}
    items = one.declaredType.items if one.type == "Enumeration" and one.declaredType is not None else ()
    return {item.name: float(item.value) for item in items} or None


def _unit(written: str | None, definition: Any) -> tuple[str, float, float]:
    """The unit of a variable, and factor and offset that bring the number of the FMU into it.

    The name is taken where it means what the FMU defines: 1/min may be defined as an angular speed, which it is not.
    """
    if written is None:
        return UNKNOWN_UNIT, 1.0, 0.0
    base = getattr(definition, "baseUnit", None)
    known = is_unit(written)
    if base is None:
        return (written if known else UNKNOWN_UNIT), 1.0, 0.0
    powers = [(symbol, int(getattr(base, symbol))) for symbol in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")]
    text = units.product_text(powers)
    factor, offset = float(base.factor), float(base.offset)
    if known and units.is_bare_rate(written) == units.is_bare_rate(text):
        try:
            own = units.conversion(written, text)
        except DeclarationError:
            return text, factor, offset
        if abs(own[0] - factor) <= _DIGITS * abs(factor) and abs(own[1] - offset) <= _DIGITS * max(1.0, abs(offset)):
            return written, 1.0, 0.0
    return text, factor, offset


def said(error: Exception) -> str:
    r"""What an error of a library says, in one line: its first two, or its kind.

    Examples
    --------
    >>> said(ValueError("not valid:\n\n- no outputs\n- no states")), said(KeyError())
    ('not valid: no outputs', 'KeyError')
    """
    lines = [line.strip(" -") for line in str(error).splitlines() if line.strip(" -")]
    return " ".join(lines[:2]) or type(error).__name__
