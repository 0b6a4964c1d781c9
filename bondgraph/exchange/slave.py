"""Co-simulation FMUs: a library wraps the text of the generated module and an adaptive integrator."""

from __future__ import annotations

import contextlib
import io
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

from bondgraph.errors import GenerationError
from bondgraph.exchange.fmu_description import variables
from bondgraph.exchange.libraries import library
from bondgraph.files import write_bytes
from bondgraph.simulate.model import Model

#: Relative tolerance of the integration from one communication point to the next, and of the absolute one per state.
_TOLERANCE = 1e-12

_SCRIPT = '''\
"""{name} as a co-simulation FMU: a generated module, integrated from one communication point to the next."""

import numpy as np
from scipy.integrate import solve_ivp
from {package} import {imported}

import {module} as equations


class {name}({base}):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = np.array({x0!r})
        self.u = np.array({u0!r})
        self.theta = np.array({theta!r})
{registrations}

{start}    def {step}(self, current_time, step_size):
        slope = lambda t, x: equations.rhs(t, x, self.u, self.theta)
        span = (current_time, current_time + step_size)
        found = solve_ivp(slope, span, self.x, method="LSODA", rtol={rtol}, atol={atol})
        self.x = found.y[:, -1]
        self.now = current_time + step_size
        return {done}

    def measured(self, k):
        return float(equations.output(getattr(self, "now", 0.0), self.x, self.u, self.theta)[k])

'''


#: Lines that a slave runs last before the first step, where states start at expressions of parameters.
_START = """\
    def exit_initialization_mode(self):
        self.x = equations.start(0.0, self.x, self.u, self.theta)

"""


def build_slave(model: Model, path: Path, version: str) -> None:
    """Write a co-simulation FMU, by pythonfmu (FMI 2.0) or pythonfmu3 (FMI 3.0).

    Raises
    ------
    GenerationError
        If the model has modes, or the library is missing.
    """
    if model.modes:
        raise GenerationError(
            f"{model.name}: modes are not carried into an FMU - derive the graph smooth (without --exact)",
            where=(model.name,),
        )
    builder = library("pythonfmu.builder" if version == "2.0" else "pythonfmu3.builder", "fmu")
    with tempfile.TemporaryDirectory() as folder:
        module = f"{model.name}_equations"
        script, equations = Path(folder) / f"{model.name}_fmi{version[0]}.py", Path(folder) / f"{module}.py"
        equations.write_text(model.text, encoding="utf-8")
        script.write_text(_script(model, module, version), encoding="utf-8")
        with contextlib.redirect_stdout(io.StringIO()):
            made = builder.FmuBuilder.build_FMU(script, dest=folder, project_files=[equations])
        content = Path(made).read_bytes()
    write_bytes(path, _described(content, model, version))


def _described(fmu: bytes, model: Model, version: str) -> bytes:
    """The FMU with what the libraries leave out: units, meanings and, in FMI 2.0, the outputs computed at the start."""
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(fmu)) as old, zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as new:
        for member in old.infolist():
            data = old.read(member)
            if member.filename == "modelDescription.xml":
                root = ET.fromstring(data)
                _add_units(root, model)
                if version == "2.0":
                    _add_unknowns(root)
                data = ET.tostring(root, encoding="utf-8", xml_declaration=True)
            new.writestr(member, data)
    return made.getvalue()


def _add_units(root: ET.Element, model: Model) -> None:
    known = {one.name: one for one in variables(model)}
    used = []
    for element in root.find("ModelVariables") or ():
        one = known.get(element.get("name", ""))
        if one is None:  # the time
            continue
        real = element.find("Real") if element.tag == "ScalarVariable" else element
        assert real is not None  # all are real numbers
        real.set("unit", one.unit)
        used.append(one.unit)
        if one.meaning:
            element.set("description", one.meaning)
    definitions = ET.Element("UnitDefinitions")
    for unit in dict.fromkeys(used):
        ET.SubElement(definitions, "Unit", name=unit)
    place = [child.tag for child in root].index("CoSimulation") + 1  # their place in the order of the standards
    root.insert(place, definitions)


def _add_unknowns(root: ET.Element) -> None:
    unknowns = ET.SubElement(next(root.iter("ModelStructure")), "InitialUnknowns")
    for index, one in enumerate(root.iter("ScalarVariable"), start=1):
        if one.get("causality") == "output":
            ET.SubElement(unknowns, "Unknown", index=str(index))


def _script(model: Model, module: str, version: str) -> str:
    two = version == "2.0"
    kind, causality, variability = ("Real", "Fmi2Causality", "Fmi2Variability") if two else (
        "Float64", "Fmi3Causality", "Fmi3Variability")  # fmt: skip
    bases = ("Fmi2Slave",) if two else ("Fmi3Slave", "Fmi3StepResult")
    rows = []
    counts: dict[str, int] = {}
    for one in variables(model):
        if one.derivative_of is not None:
            continue
        vector = {"local": "x", "input": "u", "parameter": "theta", "output": "y"}[one.causality]
        k = counts.setdefault(vector, 0)
        counts[vector] += 1
        getter = f"lambda: self.measured({k})" if vector == "y" else f"lambda: float(self.{vector}[{k}])"
        setter = "" if vector in ("x", "y") else f", setter=lambda value: self.{vector}.__setitem__({k}, value)"
        cause = "output" if vector in ("x", "y") else one.causality
        initial = f", initial={causality[:4]}Initial.calculated" if cause == "output" else ""
        rows.append(
            f"        self.register_variable({kind}({one.name!r}, causality={causality}.{cause}, "
            f"variability={variability}.{one.variability}{initial}, getter={getter}{setter}))"
        )
    if not two:
        rows.append(
            '        self.register_variable(Float64("time", causality=Fmi3Causality.independent, '
            'variability=Fmi3Variability.continuous, getter=lambda: getattr(self, "now", 0.0)))'
        )
    return _SCRIPT.format(
        name=model.name, package="pythonfmu" if two else "pythonfmu3", module=module,
        imported=", ".join((kind, causality, f"{causality[:4]}Initial", variability, *bases)),
        base=bases[0], registrations="\n".join(rows),
        x0=model.x0().tolist(), u0=model.u0().tolist(), theta=model.theta().tolist(),
        start=_START if model.parameter_starts else "",
        step="do_step", rtol=_TOLERANCE, atol=_TOLERANCE, done="True" if two else "Fmi3StepResult(True, False)",
    )  # fmt: skip
