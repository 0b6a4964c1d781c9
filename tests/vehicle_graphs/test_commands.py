"""The commands of the examples: alike in their help, in who computes, and in how they end."""

from __future__ import annotations

import importlib

import pytest

from bondgraph.errors import DataError
from vehicle_graphs.commands import run_command

SPREAD = ("thesis", "effect_study.__main__", "ranger_recorded", "radius_monitor", "baja_chain", "coupled_drives_chain")
COMMANDS = (*SPREAD, "i3_chain", "emps_chain")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_says_what_it_does(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    module = importlib.import_module(f"vehicle_graphs.{name}")
    with pytest.raises(SystemExit) as ended:
        module.main(["--help"])
    said = capsys.readouterr().out
    assert ended.value.code == 0
    assert f"usage: python -m vehicle_graphs.{name.removesuffix('.__main__')} " in said
    assert module.__doc__.splitlines()[0] in said
    assert ("--executor WHO" in said) == (name != "emps_chain")
    with pytest.raises(SystemExit) as refused:
        module.main(["--executor", "cloud"])
    assert refused.value.code == 2


def test_how_a_command_ends(capsys: pytest.CaptureFixture[str]) -> None:
    def bad() -> None:
        raise DataError("run.csv: has no time - add one")

    def stopped() -> None:
        raise KeyboardInterrupt

    assert run_command(lambda: None) == 0
    assert run_command(bad) == 2 and capsys.readouterr().err == "run.csv: has no time - add one\n"
    assert run_command(stopped, "it goes on") == 130 and capsys.readouterr().err == "stopped; it goes on\n"
