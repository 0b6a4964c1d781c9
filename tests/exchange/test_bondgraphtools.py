"""Files that BondGraphTools 0.4.6 wrote, against the state equations that it derived of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.errors import DeclarationError
from bondgraph.exchange import read_bondgraphtools

pytest.importorskip("yaml")

DRIVE = """\
models:
  /:
    components:
    - u base/Se e=12.0
    - loop base/1
    - L base/I L=0.5
    - R base/R r=2.0
    - gy base/GY R=0.3
    - shaft base/1
    - J base/I L=0.1
    - tf base/TF r=4.0
    - load base/1
    - C base/C C=0.25
    - d base/R r=0.7
    netlist:
    - u loop.non_inverting
    - loop.inverting L
    - loop.inverting R
    - loop.inverting gy.0
    - gy.1 shaft.non_inverting
    - shaft.inverting J
    - shaft.inverting tf.0
    - tf.1 load.non_inverting
    - load.inverting C
    - load.inverting d
root: drive
version: '0.1'
"""
#: dx_0 + 4*x_0 - 3*x_1 - 12, dx_1 + 3*x_0/5 + 7*x_1/16 + x_2, dx_2 - 5*x_1/2; momenta of L and J, displacement of C.
A = np.array([[-4.0, 3.0, 0.0], [-0.6, -7.0 / 16.0, -1.0], [0.0, 2.5, 0.0]])
B = np.array([12.0, 0.0, 0.0])


def _write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "drive.bg"
    path.write_text(text)
    return path


def test_it_has_the_equations_that_the_other_tool_derived(tmp_path: Path) -> None:
    model = bg.build(read_bondgraphtools(_write(tmp_path, DRIVE)))
    assert model.name == "drive"
    elements = [state.element for state in model.equations.states]
    scale = np.array([{"L": 0.5, "J": 0.1, "C": 1.0}[name] for name in elements])  # ours are flows of inertances
    order = [("L", "J", "C").index(name) for name in elements]
    for x in np.random.default_rng(0).standard_normal((4, 3)):
        expected = (A @ x + B)[order] / scale
        np.testing.assert_allclose(model.rhs(0.0, x[order] / scale, model.u0(), model.theta()), expected, rtol=1e-12)


def test_a_source_without_a_number_is_an_input(tmp_path: Path) -> None:
    graph = read_bondgraphtools(_write(tmp_path, DRIVE.replace("u base/Se e=12.0", "u base/Se")))
    assert [one.name for one in graph.inputs] == ["u_e"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("base/R r=2.0", "BioChem/Re r=2.0", "of BondGraphTools' libraries only base is read"),
        ("base/R r=2.0", "base/PH", "is of kind 'PH' - read are R, C, I"),
        ("base/R r=2.0", "base/R", "'R' has no number for 'r'"),
        ("loop.inverting R", "loop.non_inverting R", "turned against its port 'non_inverting'"),
        ("loop.inverting R", "loop.inverting Q", "a bond ends at 'Q', which is no component"),
        ("'0.1'", "'0.2'", "format version 0.2 is not 0.1"),
        ("models:", "model:", "cannot be read as a file of BondGraphTools"),
    ],
)
def test_what_is_not_read_is_told(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(DeclarationError, match=said):
        read_bondgraphtools(_write(tmp_path, DRIVE.replace(old, new)))
