"""What notebooks show: drawings, equations, tables; and results as pictures, labelled arrays and files."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from docutils.utils.math.latex2mathml import tex2mathml

import bondgraph as bg
import vehicle_graphs.ranger
from bondgraph.derive import assign_causality
from bondgraph.errors import DataError, ModelError
from bondgraph.simulate import Trajectory
from tests.test_front_door import pushed, sled


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return bg.simulate(bg.build(sled()), inputs=pushed())


def _cells(html: str) -> list[list[str]]:
    """Rows of the table in a text, cell by cell."""
    table = ET.fromstring(html[html.index("<table>") : html.index("</table>") + len("</table>")])
    return [["".join(cell.itertext()) for cell in row] for row in table]


def test_a_graph_is_shown_as_its_drawing() -> None:
    graph = sled()
    svg = graph._repr_svg_()
    assert svg is not None and ET.fromstring(svg).tag.endswith("svg")
    assert "runners" in svg
    assert assign_causality(graph)._repr_svg_() == bg.draw(graph)._repr_svg_() == svg


def test_a_graph_without_causality_is_shown_as_its_line() -> None:
    g = bg.BondGraph("stuck")
    junction = g.zero_junction("junction")
    g.effort_source("one", 1.0, at=junction)
    g.effort_source("other", 2.0, at=junction)
    assert g._repr_svg_() is None
    assert "stuck" in repr(g)


def test_equations_are_shown_as_latex_that_typesets() -> None:
    text = bg.build(sled()).equations._repr_latex_()
    assert text.startswith("$$") and text.endswith("$$")
    assert r"\dot{v} &= \frac{" in text
    mathml = ET.fromstring(tex2mathml(text.strip("$"), as_block=True))
    assert mathml.tag.endswith("math")


def test_long_equations_are_shown_without_intermediate_results() -> None:
    equations = bg.build(vehicle_graphs.ranger.full()).equations
    text = equations._repr_latex_()
    rates = re.findall(r"^\\dot\{", text, flags=re.MULTILINE)
    assert len(rates) == len(equations.states)
    assert f"after {len(equations.assignments)} assignments" in text or len(text.splitlines()) < 60


def test_results_are_shown_as_short_tables_in_declared_units(run) -> None:
    log, model = pushed(), bg.build(sled())
    known = bg.FilterModel(model, {"v": 0.1}, {"speed": 0.02}, {"v": 0.1})
    found = bg.filter_log(known, log, compiled=False)
    fit = bg.estimate(known, [log], ["mass"], bg.Settings(method="gradient", starts=1, certify="none"))
    for result in (run, found, bg.smooth(found), fit, log, bg.sensitivity(fit.problem, fit.point)):
        html = result._repr_html_()
        header, *rows = _cells(html)
        assert rows and len(html) < 3000
        assert all(len(row) == len(header) for row in rows)
        assert repr(result)[1:-1].partition(" <")[0].split(":")[0] in html
    mass = _cells(fit._repr_html_())[1]
    assert mass[:2] == ["mass", "lb"]
    assert float(mass[2]) == pytest.approx(fit.values["mass"] / 0.45359237, rel=1e-3)


def test_names_are_escaped_and_long_tables_cut() -> None:
    time = np.arange(2.0)
    channels = {f"a<{k}>": bg.LogChannel(f"a<{k}>", "m", time) for k in range(60)}
    html = bg.Log("many", time, channels)._repr_html_()
    assert "a&lt;0&gt;" in html and "<0>" not in html
    assert "and 20 rows more" in html


def test_a_simulation_is_plotted_in_declared_units(run: Trajectory) -> None:
    axes = run.plot()
    assert axes.get_ylabel() == "speed [km/h]"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 3.6 * run.output("speed"), rtol=1e-12)
    both = run.plot("v", "force", ax=axes)
    assert both is axes and len(axes.lines) == 3
    with pytest.raises(ModelError, match="no quantity 'sped'; did you mean 'speed'"):
        run.plot("sped")


def test_a_simulation_is_saved_as_a_log(run, tmp_path) -> None:
    again = bg.read_log(run.save(tmp_path / "run.csv"))
    np.testing.assert_array_equal(again.time, run.time)
    assert again.channel("speed").unit == "km/h"
    np.testing.assert_allclose(again.channel("speed").numbers, 3.6 * run.output("speed"), rtol=1e-12)
    np.testing.assert_array_equal(bg.simulate(bg.build(sled()), inputs=again).x, run.x)


def test_runs_are_labelled_arrays(run, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xarray")
    data = run.to_xarray()
    assert data["speed"].attrs == {"units": "km/h"} and data["speed"].dims == ("time",)
    np.testing.assert_array_equal(data["time"], run.time)
    np.testing.assert_array_equal(data["v"], run.state("v"))
    known = bg.FilterModel(bg.build(sled()), {"v": 0.1}, {"speed": 0.02}, {"v": 0.1})
    found = bg.filter_log(known, pushed(), compiled=False)
    np.testing.assert_array_equal(found.to_xarray()["v_std"], found.std("v"))
    smoothed = bg.smooth(found)
    np.testing.assert_array_equal(smoothed.to_xarray()["v"], smoothed.mean("v"))
    assert smoothed.plot("v").get_ylabel() == "v [m/s]"
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(DataError, match=r"to_xarray: xarray is not installed - run: pip install 'bondloop\[frames\]'"):
        run.to_xarray()
