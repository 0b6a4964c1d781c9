"""Corrections go to a file or a folder and come back, in another process too."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph as bg
from bondgraph import effects
from bondgraph.errors import NotKeptError, OptionError
from bondgraph.report.html import report_html
from bondgraph.report.saved import NAME
from bondgraph.report.saved_correction import SavedCorrection
from bondgraph.simulate.stored import store
from tests.correct.sled import added, pull, sled

pytestmark = pytest.mark.usefixtures("undrawn")

#: What a folder cannot do without.
PARTS = (NAME, "result.json", "declared_graph.json", "corrected_graph.json")

ELSEWHERE = """
import sys
import bondgraph as bg
loop = bg.Correction.load(sys.argv[1])
print(loop.summary())
print(loop.python_lines())
print(loop.to_dataframe().to_json())
print(bg.simulate(loop.model, [0.0, 0.1, 0.2], {"torque": 3.0}).x.tolist())
"""


@pytest.fixture(scope="module")
def loop() -> bg.Correction:
    true = added(effects.quadratic_loss, "runner", 1.2)
    laws, settings = (effects.quadratic_loss,), bg.LoopSettings(faults=False)
    return bg.close_loop(sled(), pull(true, 1), pull(true, 2, name="later"), laws, settings)


@pytest.fixture(params=["loop.npz", "loop", "report"])
def there(request: pytest.FixtureRequest, loop: bg.Correction, tmp_path: Path) -> Path:
    """A correction in each form in which one is kept."""
    if request.param == "report":
        return loop.report(tmp_path / "report").parent
    return loop.save(tmp_path / request.param)


def said(loop: Any) -> dict[str, Any]:
    """Every public number and text of a correction."""
    return {
        "verdict": loop.verdict, "reason": loop.reason, "cautions": loop.cautions, "summary": loop.summary(),
        "table": loop.table(), "html": loop._repr_html_().partition("</p>")[2], "result": loop.result,
        "parameters": loop.parameters, "effects": loop.effects, "lines": loop.python_lines(), "graph": loop.graph,
        "declared": loop.declared, "corrected": loop.corrected_graph, "module": loop.model.text,
        "estimates": loop.to_dataframe().to_json(double_precision=15), "page": report_html(loop.kept.data),
        "plot": [np.asarray(line.get_xydata()).tobytes() for line in loop.plot().lines],
    }  # fmt: skip


def test_every_public_number_comes_back(loop: bg.Correction, there: Path) -> None:
    again, before = bg.Correction.load(there), said(loop)
    assert said(again) == before
    assert "quadratic_loss at runner" in again.summary() and again.effects[0].name == "quadratic_loss"
    assert repr(again) == "<SavedCorrection sled: effect found; added quadratic_loss at runner>"
    assert again.parameters["c_quadratic_loss_runner"]["value"] == loop.corrected.values["c_quadratic_loss_runner"]
    assert len(again.python_lines()) > 50


def test_what_comes_back_is_saved_and_reported_again(loop: bg.Correction, tmp_path: Path) -> None:
    again = bg.Correction.load(loop.save(tmp_path / "loop.npz"))
    written = again.report(tmp_path / "again").parent
    assert said(type(again).load(written)) == said(loop)
    loop.report(tmp_path / "first")
    for path in (tmp_path / "first").iterdir():
        if path.suffix != ".npz":
            assert (written / path.name).read_bytes() == path.read_bytes(), path.name


def test_a_saved_correction_goes_on_in_another_process(loop: bg.Correction, there: Path) -> None:
    done = subprocess.run([sys.executable, "-c", ELSEWHERE, str(there)], capture_output=True, text=True, check=True)
    run = bg.simulate(loop.model, [0.0, 0.1, 0.2], {"torque": 3.0}).x.tolist()
    table = loop.to_dataframe().to_json()
    assert done.stdout == "\n".join([loop.summary(), loop.python_lines(), table, str(run), ""])


def test_what_a_file_does_not_keep_is_said(loop: bg.Correction, tmp_path: Path) -> None:
    again = bg.Correction.load(loop.save(tmp_path / "loop.npz"))
    for name in ("rounds", "corrected", "nominal_train", "added", "detectable"):
        assert hasattr(loop, name) and not hasattr(again, name)
        with pytest.raises(NotKeptError, match=f"^{name}: fits, runs and candidates are not kept in a file - close"):
            getattr(again, name)
    with pytest.raises(AttributeError, match="no attribute 'sumary'"):
        again.sumary  # noqa: B018


def test_files_of_something_else_are_refused(loop: bg.Correction, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"run\.npz: holds a Trajectory, no SavedCorrection"):
        bg.Correction.load(store(bg.simulate(loop.model, [0.0, 0.1]), tmp_path / "run.npz"))
    with pytest.raises(OptionError, match=r"none\.npz: there is no such file"):
        bg.Correction.load(tmp_path / "none.npz")
    whole = loop.save(tmp_path / "loop.npz").read_bytes()
    for size in (0, 100, len(whole) // 2, len(whole) - 10):
        (tmp_path / "cut.npz").write_bytes(whole[:size])
        with pytest.raises(OptionError, match=r"cut\.npz: cannot be read"):
            bg.Correction.load(tmp_path / "cut.npz")
    with pytest.raises(OptionError, match=r"holds no report_data\.npz, result\.json.* - name a folder that close-loop"):
        bg.Correction.load(tmp_path)


@pytest.mark.parametrize("name", PARTS)
def test_folders_that_lack_a_part_or_hold_half_of_one_are_refused(
    name: str, loop: bg.Correction, tmp_path: Path
) -> None:
    folder = loop.save(tmp_path / "loop")
    assert sorted(path.name for path in folder.iterdir()) == sorted(PARTS)
    whole = (folder / name).read_bytes()
    (folder / name).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(OptionError, match="cannot be read"):
        bg.Correction.load(folder)
    (folder / name).unlink()
    with pytest.raises(OptionError, match=f"holds no {name}"):
        bg.Correction.load(folder)


def test_folders_of_two_machines_are_refused(loop: bg.Correction, tmp_path: Path) -> None:
    folder = loop.save(tmp_path / "loop")
    other = json.loads((folder / "declared_graph.json").read_text())
    other["graph"]["name"] = "cart"
    (folder / "declared_graph.json").write_text(json.dumps(other))
    with pytest.raises(OptionError, match="two machines, cart and sled"):
        bg.Correction.load(folder)
    (folder / "result.json").write_text('{"parameters": {}}')
    with pytest.raises(OptionError, match="no result of a closed loop"):
        bg.Correction.load(folder)


def test_a_record_is_what_a_file_holds(loop: bg.Correction) -> None:
    assert isinstance(loop.kept, SavedCorrection) and loop.kept.kept is loop.kept
