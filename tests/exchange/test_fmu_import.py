"""FMUs beside a model: our own read back, those of others, and what cannot be done with them."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.cli import main
from bondgraph.data.log import Log, LogChannel
from bondgraph.data.write import write_log
from bondgraph.errors import DataError, ModelError, OptionError
from bondgraph.exchange import export_fmu, fmu_outputs, read_fmu
from bondgraph.simulate.example import pendulum

pytest.importorskip("fmpy")
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

#: An FMU as others write them with pythonfmu: a tank heater with a switch, a mode and a level, and no units.
_HEATER = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String

class Heater(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.power, self.on, self.level, self.capacity = 0.0, False, 1, 50.0
        self.temperature, self.label = 20.0, "cold"
        into, out = Fmi2Causality.input, Fmi2Causality.output
        self.register_variable(Real("power", causality=into))
        self.register_variable(Boolean("on", causality=into, variability=Fmi2Variability.discrete))
        self.register_variable(Integer("level", causality=into, variability=Fmi2Variability.discrete))
        self.register_variable(
            Real("capacity", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        )
        self.register_variable(Real("temperature", causality=out))
        self.register_variable(String("label", causality=out))

    def do_step(self, current_time, step_size):
        if self.level < 0:
            raise ValueError("no such level")
        self.temperature += step_size * self.on * self.level * self.power / self.capacity
        return True
"""


def _pushed(time: np.ndarray) -> tuple[Log, np.ndarray]:
    """A log that pushes the pendulum, in degrees, and the push in the unit of the model."""
    push = np.sin(3.0 * time) + 0.3 * np.random.default_rng(0).standard_normal(time.size)
    return Log("push", time, {"drive": LogChannel("drive", "deg/s^2", np.rad2deg(push))}), push


def _uneven() -> np.ndarray:
    return np.sort(np.concatenate([np.arange(0.0, 4.0, 0.05), [0.013, 1.777, 3.111]]))


def _held(model: Any, time: np.ndarray, push: np.ndarray, **how: Any) -> np.ndarray:
    """The deflection of a pendulum whose push is held from sample to sample: one simulation for each."""
    x, found = model.x0(), []
    for k in range(time.size):
        found.append(model.output(time[k], x, np.array([push[k]]), model.theta())[0])
        if k + 1 < time.size:
            both = time[k : k + 2]
            names = dict(zip(model.names("state"), x, strict=True))
            x = bg.simulate(model, both, {"drive": push[k]}, x0=names, rtol=1e-11, **how).x[:, -1]
    return np.array(found)


@needs_compiler
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_model_exchange_gives_our_own_trajectory_between_uneven_samples(version: Any, tmp_path: Path) -> None:
    model = pendulum()
    path = export_fmu(model, tmp_path / "swing.fmu", version)
    log, push = _pushed(_uneven())
    found = fmu_outputs(path, log, values={"length": 1.4, "angle": 0.3})
    own = bg.simulate(model, log.time, push[np.newaxis], {"length": 1.4}, {"angle": 0.3}, rtol=1e-11)
    assert list(found.channels) == ["deflection"] and found.channel("deflection").unit == "m"
    np.testing.assert_allclose(found.channel("deflection").numbers, own.y[0], atol=1e-6)
    held = fmu_outputs(path, log, held=["drive"])
    np.testing.assert_allclose(held.channel("deflection").numbers, _held(model, log.time, push), atol=1e-6)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_co_simulation_converges_with_the_square_of_its_steps(version: Any, tmp_path: Path) -> None:
    pytest.importorskip("pythonfmu" if version == "2.0" else "pythonfmu3")
    model = pendulum()
    path = export_fmu(model, tmp_path / "swing.fmu", version, "co-simulation")
    log, push = _pushed(np.arange(0.0, 3.0, 0.05))
    own = bg.simulate(model, log.time, push[np.newaxis], rtol=1e-11).y[0]
    errors = [
        np.abs(fmu_outputs(path, log, steps=steps).channel("deflection").numbers - own).max() for steps in (2, 4, 8)
    ]
    assert 3.8 < errors[0] / errors[1] < 4.2 and 3.8 < errors[1] / errors[2] < 4.2 and errors[2] < 1e-4
    held = fmu_outputs(path, log, held=["drive"], steps=1)
    np.testing.assert_allclose(held.channel("deflection").numbers, _held(model, log.time, push), atol=1e-8)


def test_variables_have_the_units_of_the_model_in_every_kind_of_fmu(tmp_path: Path) -> None:
    pytest.importorskip("pythonfmu3")
    for version in ("2.0", "3.0"):
        fmu = read_fmu(export_fmu(pendulum(), tmp_path / "swing.fmu", version, "co-simulation"))  # type: ignore[arg-type]
        assert [(one.name, one.unit) for one in fmu.inputs] == [("drive", "rad/s^2")]
        assert {one.name: one.unit for one in fmu.parameters}["length"] == "m"


def _edited(path: Path, made: Path, edit: Callable[[ET.Element], None]) -> Path:
    """An FMU whose description was edited."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(made, "w") as new:
        for member in old.infolist():
            data = old.read(member)
            if member.filename == "modelDescription.xml":
                root = ET.fromstring(data)
                edit(root)
                data = ET.tostring(root)
            new.writestr(member, data)
    return made


@needs_compiler
def test_units_mean_what_the_fmu_defines(tmp_path: Path) -> None:
    """A maker may define 1/min as an angular speed, and write units that no library knows."""
    path = export_fmu(pendulum(), tmp_path / "swing.fmu")
    factor = {"tick": ("0.25", {"rad": "1", "s": "-2"}), "cm": ("0.01", {"m": "1"}), "1/min": ("0.5", {"rad": "1"})}

    def edit(root: ET.Element) -> None:
        definitions = root.find("UnitDefinitions")
        assert definitions is not None
        for name, (size, powers) in factor.items():
            unit = ET.SubElement(definitions, "Unit", name=name)
            ET.SubElement(unit, "BaseUnit", {**powers, "factor": size})
        for one in root.iter("ScalarVariable"):
            unit_of = {"drive": "tick", "deflection": "cm", "length": "1/min"}.get(one.get("name", ""))
            if unit_of is not None:
                one[0].set("unit", unit_of)

    fmu = read_fmu(_edited(path, tmp_path / "other.fmu", edit))
    (drive,), (deflection,) = fmu.inputs, fmu.outputs
    assert (drive.unit, drive.factor) == ("rad/s^2", 0.25)
    assert (deflection.unit, deflection.factor) == ("cm", 1.0)
    assert next((one.unit, one.factor) for one in fmu.parameters if one.name == "length") == ("rad", 0.5)
    time = np.arange(0.0, 1.0, 0.05)
    log = Log("push", time, {"drive": LogChannel("drive", "rad/s^2", np.full(time.size, 0.5))})
    found = fmu_outputs(fmu.path, log)
    own = bg.simulate(pendulum(), time, {"drive": 2.0}, rtol=1e-10)  # 0.5 rad/s^2 are two ticks
    assert found.channel("deflection").unit == "cm"
    np.testing.assert_allclose(found.channel("deflection").numbers, own.y[0], atol=1e-6)


@pytest.fixture(scope="module")
def heater(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU that somebody else might have made."""
    builder = pytest.importorskip("pythonfmu.builder")
    folder = tmp_path_factory.mktemp("heater")
    (folder / "heater.py").write_text(_HEATER)
    with contextlib.redirect_stdout(io.StringIO()):
        return Path(builder.FmuBuilder.build_FMU(folder / "heater.py", dest=folder))


def _heating(**columns: Any) -> Log:
    time = np.arange(0.0, 2.01, 0.1)
    channels = {
        "power": LogChannel("power", "W", np.full(time.size, 100.0)),
        "on": LogChannel("on", "text", np.where(time < 0.95, "true", "false")),
        "level": LogChannel("level", "1", np.where(time < 0.45, 1.0, 3.0)),
    }
    return Log("heating", time, channels | columns)


def test_an_fmu_of_another_maker(heater: Path) -> None:
    """With switches, levels, text and no units: 10 samples of heat, of which 5 are three times the others."""
    log = _heating()
    found = fmu_outputs(heater, log, units={"power": "kW", "temperature": "degC"}, values={"capacity": 0.01})
    assert read_fmu(heater).problem  # it lacks what the standard asks for, and runs all the same
    temperature = found.channel("temperature")
    assert list(found.channels) == ["temperature"] and temperature.unit == "degC"
    samples = np.arange(len(log))
    heat = 0.1 * 0.1 / 0.01 * (np.minimum(samples, 5) + 3.0 * np.clip(samples - 5, 0, 5))
    np.testing.assert_allclose(temperature.numbers, 20.0 + heat, rtol=1e-12)


@pytest.mark.parametrize(
    ("columns", "how", "message"),
    [
        ({}, {}, "column 'power' has unit 'W', but Heater does not say which unit it takes - say it with units="),
        ({}, {"units": {"power": "V"}}, r"column 'power' has unit 'W' .* needs 'V'"),
        ({}, {"units": {"powre": "W"}}, "a unit is given for 'powre', which Heater does not have; did you mean"),
        ({}, {"units": {"power": "Wat"}}, "'power' cannot have that unit, and 'Wat' is given"),
        ({}, {"units": {"power": "W"}, "values": {"mass": 1.0}}, "no input, parameter or start value 'mass'"),
        ({}, {"units": {"power": "W"}, "held": ["lamp"]}, "Heater has no input 'lamp' to hold"),
        ({}, {"units": {"power": "W"}, "kind": "model-exchange"}, "is for co-simulation, not model-exchange"),
        ({}, {"units": {"power": "W"}, "steps": 0}, "at least one is needed"),
        ({"level": LogChannel("level", "1", np.full(21, 1.5))}, {"units": {"power": "W"}}, "1.5 .*of type Integer"),
        ({"on": LogChannel("on", "text", np.full(21, "maybe"))}, {"units": {"power": "W"}}, "has 'maybe'"),
        ({"level": LogChannel("level", "1", np.full(21, -1.0))}, {"units": {"power": "W"}}, "the FMU fails as co-sim"),
        ({"on": LogChannel("on", "text", np.full(21, ""))}, {"units": {"power": "W"}}, "no values for the input 'on'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_an_fmu_is_said(columns: Any, how: Any, message: str, heater: Path) -> None:
    with pytest.raises((DataError, ModelError, OptionError), match=message):
        fmu_outputs(heater, _heating(**columns), **how)


def test_uneven_steps_need_an_fmu_that_takes_them(heater: Path, tmp_path: Path) -> None:
    def edit(root: ET.Element) -> None:
        root.find("CoSimulation").set("canHandleVariableCommunicationStepSize", "false")  # type: ignore[union-attr]

    even = _edited(heater, tmp_path / "even.fmu", edit)
    log, units = _heating(), {"power": "W"}
    uneven = log.rows(np.arange(len(log)) != 7)
    fmu_outputs(heater, uneven, units=units)
    one, other = (fmu_outputs(path, log, units=units).channel("temperature").numbers for path in (even, heater))
    np.testing.assert_allclose(one, other, rtol=1e-12)
    with pytest.raises(DataError, match="heating: the steps of time are uneven, and Heater allows even ones only"):
        fmu_outputs(even, uneven, units=units)


def test_what_is_no_fmu(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"none\.fmu: no such file"):
        read_fmu(tmp_path / "none.fmu")
    (tmp_path / "text.fmu").write_text("time [s],force [N]\n")
    with pytest.raises(ModelError, match=r"text\.fmu: not an FMU, which is an archive"):
        read_fmu(tmp_path / "text.fmu")
    with zipfile.ZipFile(tmp_path / "empty.fmu", "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(ModelError, match=r"empty\.fmu: not an FMU, which is an archive with .*modelDescription"):
        read_fmu(tmp_path / "empty.fmu")
    with zipfile.ZipFile(tmp_path / "broken.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", '<fmiModelDescription fmiVersion="2.0"/>')
    with pytest.raises(ModelError, match=r"broken\.fmu: the description of the FMU cannot be read"):
        read_fmu(tmp_path / "broken.fmu")


@needs_compiler
def test_an_fmu_of_another_machine(tmp_path: Path) -> None:
    path = export_fmu(pendulum(), tmp_path / "swing.fmu")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(tmp_path / "bare.fmu", "w") as new:
        for member in old.infolist():
            if not member.filename.startswith("binaries"):
                new.writestr(member, old.read(member))
    with pytest.raises(ModelError, match=r"has no binary for this machine .* it has c-code - compile its sources"):
        fmu_outputs(tmp_path / "bare.fmu", _pushed(_uneven())[0])


@needs_compiler
def test_commands_take_an_fmu(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    export_fmu(pendulum(), "swing.fmu")
    log, push = _pushed(_uneven())
    own = bg.simulate(pendulum(), log.time, push[np.newaxis], {"length": 1.4}, rtol=1e-11).y[0]
    measured = Log("run", log.time, {**log.channels, "x": LogChannel("x", "mm", 1e3 * own)})
    write_log("run.csv", measured)
    assert main(["simulate", "swing.fmu", "--inputs", "run.csv", "--set", "length=1.4", "--out", "o.csv"]) == 0
    np.testing.assert_allclose(bg.read_log("o.csv").channel("deflection").numbers, own, atol=1e-6)
    assert main(["simulate", "swing.fmu", "--inputs", "run.csv", "--from", "1", "--until", "2", "--plot", "o.png"]) == 0
    assert Path("o.png").is_file()
    compare = ["compare", "swing.fmu", "--data", "run.csv", "--map", "x=deflection"]
    assert main([*compare, "--set", "length=1.4"]) == 0
    assert "run: deflection [m]" in capsys.readouterr().out
    assert Path("compared/run_compared.png").is_file() and Path("compared/run_simulated.csv").is_file()
    held = ["--inputs-between", "held", "--set", "length=1.4"]
    assert main([*compare, *held]) == 0
    assert "100.0" not in capsys.readouterr().out


@needs_compiler
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "an FMU is simulated along a log - give it with --inputs"),
        (("--inputs", "run.csv", "--exact"), "--exact is not for an FMU"),
        (("--inputs", "run.csv", "--step", "0.1"), "--step is not for an FMU: it answers at the samples"),
        (("--inputs", "run.csv", "--start", "settled"), "--start settled is not for an FMU"),
        (("--inputs", "run.csv", "--inputs-between", "band"), "inputs of an FMU are held or linear"),
        (("--inputs", "run.csv", "--fmu-units", "drive"), "--fmu-units drive: write it as column=unit"),
        (("--inputs", "run.csv", "--units", "drive=N"), "has unit 'N' .* needs 'rad/s^2'"),
        (("--inputs", "run.csv", "--map", "drive=force"), "mapped to 'force', which pendulum does not have"),
    ],
)  # fmt: skip
def test_commands_say_what_an_fmu_has_not(
    arguments: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    export_fmu(pendulum(), "swing.fmu")
    write_log("run.csv", _pushed(_uneven())[0])
    assert main(["simulate", "swing.fmu", *arguments]) == 2
    assert re.search(message.replace("^", r"\^"), capsys.readouterr().err)


def test_an_fmu_is_no_graph(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["filter", "engine.fmu", "--data", "run.csv"]) == 2
    assert "an FMU holds compiled code and no equations, so it is no graph" in capsys.readouterr().err


def test_blocks_of_co_simulation_are_no_seams(heater: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log, units = _heating(power=LogChannel("power", "W", np.linspace(0.0, 40.0, 21) ** 2)), {"power": "W"}
    whole = fmu_outputs(heater, log, units=units).channel("temperature").numbers
    monkeypatch.setattr("bondgraph.exchange.fmu_course._BLOCK", 7)
    np.testing.assert_array_equal(fmu_outputs(heater, log, units=units).channel("temperature").numbers, whole)
