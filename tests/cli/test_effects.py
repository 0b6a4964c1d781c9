"""Which effects a command line chooses: modules, names, what is left out."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import bondgraph
from bondgraph import effects
from bondgraph.cli import main
from bondgraph.cli.effects import SHIPPED, chosen_effects
from bondgraph.declare.effect import effect_functions
from bondgraph.effects.sensors import SENSOR_FAULTS
from bondgraph.errors import OptionError

OWN = """
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.graph import BondGraph
from bondgraph.effects import backlash


def spring_hardens(g: BondGraph, at: Place) -> Effect | None: ...
def spring_softens(g: BondGraph, at: Place) -> Effect | None: ...
"""
#: Files that only import effects, in the ways in which one may write that.
ONLY_IMPORTS = {
    "names": "from bondgraph.effects import backlash, creep\nfrom math import sin\n",
    "listed": "from bondgraph.effects.gaps import *\nfrom bondgraph.effects import creep\n"
    "__all__ = ['backlash', 'creep']\n",
    "old place": "from vehicle_graphs.effects import backlash as backlash, creep as creep\n",
}


def names(given: list[str], without: list[str] | None = None) -> list[str]:
    return [one.__name__ for one in chosen_effects(given, without or [])]


@pytest.fixture
def own(tmp_path: Path) -> str:
    path = tmp_path / "own_laws.py"
    path.write_text(OWN, encoding="utf-8")
    return str(path)


def test_modules_files_and_single_effects_are_chosen_once_and_in_order(own: str) -> None:
    everything = [one.__name__ for one in effect_functions(effects)]
    assert names(["bondgraph.effects"]) == everything
    assert names([own, "creep"]) == ["spring_hardens", "spring_softens", "creep"]
    assert names([f"{own}:spring_softens", "vehicle_graphs.effects:backlash,backlash"]) == [
        "spring_softens",
        "backlash",
    ]


def test_shipped_effects_and_faults_can_be_left_out(own: str) -> None:
    left = names(["bondgraph.effects", own], ["backlash", "spring_softens,sensor_delay"])
    assert "backlash" not in left and "creep" in left and left[-1] == "spring_hardens"
    assert {one.__name__ for one in SENSOR_FAULTS} >= {"sensor_delay"}


@pytest.mark.parametrize("text", ONLY_IMPORTS.values(), ids=ONLY_IMPORTS)
def test_a_module_that_only_imports_effects_offers_them(tmp_path: Path, text: str) -> None:
    """It had none, unless it was a package: "no effect to try"."""
    path = tmp_path / "my_choice.py"
    path.write_text(text, encoding="utf-8")
    assert names([str(path)]) == ["backlash", "creep"]


def test_a_folder_of_the_user_hides_no_effect_of_the_toolkit(tmp_path: Path) -> None:
    """The effects lay in ``vehicle_graphs``, which a folder of that name hid: no effect was known any more."""
    (tmp_path / "vehicle_graphs").mkdir()
    (tmp_path / "vehicle_graphs" / "__init__.py").write_text("", encoding="utf-8")
    asked = "from bondgraph.cli.effects import SHIPPED, chosen_effects; print(len(chosen_effects([SHIPPED])))"
    environment = {**os.environ, "PYTHONPATH": str(Path(bondgraph.__file__).parents[1])}
    run = subprocess.run(
        [sys.executable, "-c", asked], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert int(run.stdout) == len(effect_functions(effects))


@pytest.mark.parametrize(
    ("given", "without", "message"),
    [
        (
            ["backlsh"],
            [],
            r"--effects backlsh: there is no module 'backlsh'.*did you mean 'backlash'.*a shipped effect",
        ),
        (["bondgraph.effects:crep"], [], r"has no effect function 'crep'.*did you mean 'creep'"),
        (["math"], [], r"--effects math: math has no effect functions - they take a graph and a Place"),
        (["creep"], ["crep"], r"--without crep: no effect of this name is tried.*'creep'"),
        (["creep"], ["creep"], r"--without leaves no effect to try"),
    ],
)
def test_what_is_no_effect_is_refused(given: list[str], without: list[str], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        chosen_effects(given, without)


def test_a_wrong_name_ends_with_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.csv"
    log.write_text("time [s],engine_torque [N m],engine_speed [rad/s]\n0,1,100\n0.1,1,100\n", encoding="utf-8")
    command = ["close-loop", "vehicle_graphs.driveline:driveline", "--data", str(log), "--out", str(tmp_path / "out")]
    assert main([*command, "--effects", "backlsh"]) == 2
    assert "backlsh" in capsys.readouterr().err


def test_names_in_the_words_of_a_domain_are_names_too() -> None:
    """``bondgraph effects`` lists heat_bridge, and --effects knew leak_between alone."""
    assert names(["heat_bridge"]) == ["leak_between"] == names(["leak_between"])
    assert "leak_between" not in names([SHIPPED], ["heat_bridge"])
    with pytest.raises(OptionError, match="did you mean 'heat_bridge'"):
        names(["heat_brigde"])
