"""The description of an FMU: its variables and how they depend on each other, FMI 2.0 and 3.0."""

from __future__ import annotations

import uuid
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

from bondgraph.simulate.model import Model

#: Name space of the tokens by which an importer checks that binary and description belong together.
_TOKENS = uuid.UUID("5b0f5dc1-6c5c-4dc8-8d9c-1d6f1f6d2c53")
_TOOL = "bondgraph"


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU; ``start`` is None where it is computed, ``derivative_of`` the position of a state.

    A state that starts where parameters say is computed until the initialisation ends.
    """

    name: str
    causality: str
    variability: str
    unit: str
    meaning: str
    start: float | None = None
    derivative_of: int | None = None


def token(model: Model, version: str) -> str:
    """The token of the FMU of a model: the same for the same equations."""
    return f"{{{uuid.uuid5(_TOKENS, f'{model.digest} {version}')}}}"


def variables(model: Model) -> list[Variable]:
    """States, derivatives, inputs, parameters and outputs in the order of their references, in units of the model.

    A name that stands twice (an output called like a state) gets its kind in front, a derivative is ``der(state)``.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> [one.name for one in variables(pendulum())]
    ['angle', 'rate', 'der(angle)', 'der(rate)', 'drive', 'length', 'damping', 'gravity', 'deflection']
    """
    x0, u0, theta = model.x0(), model.u0(), model.theta()
    computed = model.parameter_starts
    found = [
        Variable(one.name, "local", "continuous", one.unit, one.meaning, None if one.name in computed else float(value))
        for one, value in zip(model.states, x0, strict=True)
    ]
    found += [
        Variable(f"der({one.name})", "local", "continuous", f"({one.unit})/s", "", None, k)
        for k, one in enumerate(model.states)
    ]
    rows = [(one.name, one.unit, one.meaning, float(u), "input") for one, u in zip(model.inputs, u0, strict=True)]
    rows += [(p.name, p.unit, p.meaning, float(v), "parameter") for p, v in zip(model.parameters, theta, strict=True)]
    last = [(one.name, one.unit, one.meaning, None, "output") for one in model.outputs]
    held = {one.name for one in model.inputs if one.interpolation == "hold"}  # an importer stops where they jump
    for name, unit, meaning, start, causality in (*rows, *last):
        own = f"{causality}.{name}" if name in {one.name for one in found} else name
        variability = {"parameter": "tunable", "input": "discrete" if name in held else "continuous"}.get(
            causality, "continuous"
        )
        found.append(Variable(own, causality, variability, unit, meaning, start))
    return found


def description(model: Model, version: str) -> bytes:
    """``modelDescription.xml`` of the model-exchange FMU of a model; ``version`` is ``"2.0"`` or ``"3.0"``."""
    root = _root(model, version)
    listed = variables(model)
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(one.unit for one in listed):
        ET.SubElement(units, "Unit", name=unit)
    table = ET.SubElement(root, "ModelVariables")
    (_variables2 if version == "2.0" else _variables3)(table, listed)
    (_structure2 if version == "2.0" else _structure3)(ET.SubElement(root, "ModelStructure"), listed)
    ET.indent(root)
    content: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


def _root(model: Model, version: str) -> ET.Element:
    meaning = model.doc.partition("\n")[0]
    head = {"fmiVersion": version, "modelName": model.name, "description": meaning, "generationTool": _TOOL}
    if version == "2.0":
        head |= {"guid": token(model, version), "numberOfEventIndicators": "0", "variableNamingConvention": "flat"}
    else:
        head |= {"instantiationToken": token(model, version)}
    root = ET.Element("fmiModelDescription", head)
    exchange = ET.SubElement(root, "ModelExchange", modelIdentifier=model.name)
    if version == "2.0":
        files = ET.SubElement(exchange, "SourceFiles")
        ET.SubElement(files, "File", name="fmi2.c")
    return root


def _common(one: Variable, reference: int) -> dict[str, str]:
    given = {"name": one.name, "valueReference": str(reference), "causality": one.causality}
    given |= {"variability": one.variability, "description": one.meaning}
    if one.causality != "input" and one.derivative_of is None:
        given["initial"] = "calculated" if one.start is None else "exact"
    return {key: value for key, value in given.items() if value}


def _variables2(table: ET.Element, listed: Sequence[Variable]) -> None:
    for reference, one in enumerate(listed):
        row = ET.SubElement(table, "ScalarVariable", _common(one, reference))
        real = {"unit": one.unit}
        if one.start is not None:
            real["start"] = repr(one.start)
        if one.derivative_of is not None:
            real["derivative"] = str(one.derivative_of + 1)
        ET.SubElement(row, "Real", real)


def _variables3(table: ET.Element, listed: Sequence[Variable]) -> None:
    for reference, one in enumerate(listed):
        given = _common(one, reference) | {"unit": one.unit}
        if one.start is not None:
            given["start"] = repr(one.start)
        if one.derivative_of is not None:
            given["derivative"] = str(one.derivative_of)
        ET.SubElement(table, "Float64", given)
    time = {"name": "time", "valueReference": str(len(listed)), "causality": "independent", "variability": "continuous"}
    ET.SubElement(table, "Float64", time)


def _unknowns(listed: Sequence[Variable]) -> tuple[list[int], list[int]]:
    outputs = [k for k, one in enumerate(listed) if one.causality == "output"]
    return outputs, [k for k, one in enumerate(listed) if one.derivative_of is not None]


def _computed_states(listed: Sequence[Variable]) -> list[int]:
    local = [(k, one) for k, one in enumerate(listed) if one.causality == "local" and one.derivative_of is None]
    return [k for k, one in local if one.start is None]


def _structure2(structure: ET.Element, listed: Sequence[Variable]) -> None:
    outputs, derivatives = _unknowns(listed)
    unknown = [*_computed_states(listed), *outputs, *derivatives]
    for name, found in (("Outputs", outputs), ("Derivatives", derivatives), ("InitialUnknowns", unknown)):
        if found:
            group = ET.SubElement(structure, name)
            for k in sorted(found):
                ET.SubElement(group, "Unknown", index=str(k + 1))


def _structure3(structure: ET.Element, listed: Sequence[Variable]) -> None:
    outputs, derivatives = _unknowns(listed)
    for name, found in (
        ("Output", outputs),
        ("ContinuousStateDerivative", derivatives),
        ("InitialUnknown", [*_computed_states(listed), *derivatives, *outputs]),
    ):  # fmt: skip
        for k in found:
            ET.SubElement(structure, name, valueReference=str(k))
