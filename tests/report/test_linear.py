"""The linear model of a declared graph as people read it: text, JSON, Bode diagram."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.signal

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.linearisation import LinearModel, Units
from bondgraph.derive.response import frequency_response, margins
from bondgraph.errors import DerivationError, OptionError
from bondgraph.report.figures import save_figure
from bondgraph.report.linear import bode_figure, linear_answer, linear_json, linear_text, transfer_text
from vehicle_graphs.driveline import driveline


def oscillator() -> BondGraph:
    g = BondGraph("oscillator", doc="A mass on a spring.\n\nMore about it.")
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("push", g.input("F", "N"), at=body)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body, state="v")
    g.resistance("drag", g.parameter("d", 0.4, "N s/m"), at=body)
    g.compliance("spring", g.parameter("k", 8.0, "N/m"), at=body, state="q")
    g.measure_flow("speed", body)
    return g


def test_the_matrices_are_those_of_the_textbook():
    answer = linear_json(linear_answer(oscillator(), {"m": 4.0}))
    assert answer["states"] == ["v", "q"]
    assert answer["A"] == [[-0.1, -2.0], [1.0, 0.0]] and answer["B"] == [[0.25], [0.0]]
    assert answer["C"] == [[1.0, 0.0]] and answer["D"] == [[0.0]]
    assert answer["modes"][0]["natural_frequency"] == pytest.approx(np.sqrt(2.0))
    assert answer["modes"][0]["damping"] == pytest.approx(0.1 / (2 * np.sqrt(2.0)))


def test_the_text_names_point_modes_and_matrices():
    text = linear_text(linear_answer(oscillator(), {"F": 8.0}, steady=True))
    assert text.startswith("oscillator: A mass on a spring.\n") and "More about it" not in text
    assert "equilibrium: the rates vanish" in text
    assert "q                                   1 m" in text
    assert all(f"\n{letter} " in text for letter in "ABCD")


def test_a_linear_graph_has_its_transfer_function_in_symbols():
    text = transfer_text(linear_answer(oscillator(), {}), "F", "speed")
    assert "= s/(d*s + k + m*s**2)" in text and "= 0.5*s/(s**2 + 0.2*s + 4.0)" in text
    assert "zeros [1/s]: 0" in text


def test_a_nonlinear_graph_has_it_at_its_operating_point():
    answer = linear_answer(driveline(), {"engine_torque": 30.0}, steady=True)
    text = transfer_text(answer, "engine_torque", "speed")
    assert "at this operating point" in text and "zeros [1/s]: -100" in text


def test_the_frequency_response_is_that_of_scipy():
    model = linear_answer(driveline(), {"engine_torque": 30.0}, steady=True).model
    frequencies = np.geomspace(1e-3, 1e3, 50)
    response = frequency_response(model, frequencies)
    for column in range(len(model.inputs)):
        numerators, denominator = scipy.signal.ss2tf(model.A, model.B, model.C, model.D, input=column)
        for row, numerator in enumerate(numerators):
            _, expected = scipy.signal.freqs(numerator, denominator, 2 * np.pi * frequencies)
            np.testing.assert_allclose(response[row, column], expected, rtol=1e-6, atol=1e-9)


def test_a_bode_diagram_is_drawn(tmp_path: Path):
    answer = linear_answer(oscillator(), {})
    figure = bode_figure(answer, [("F", "speed")])
    curve = figure.axes[0].lines[0]
    peak = np.argmax(curve.get_ydata())
    assert curve.get_xdata()[peak] == pytest.approx(1 / np.pi, rel=0.02)
    assert curve.get_ydata()[peak] == pytest.approx(20 * np.log10(1 / 0.4), abs=0.1)
    assert figure.axes[0].get_ylabel() == "magnitude [dB of m/s per N]"
    assert figure.get_suptitle() == "at v = 0 m/s, q = 0 m, F = 0 N"
    said = [axes.texts[0].get_text() for axes in figure.axes]
    assert said[0] == "no gain margin: the phase never is -180 deg" and said[1].startswith("phase margin ")
    save_figure(figure, tmp_path / "bode.png")
    assert (tmp_path / "bode.png").stat().st_size > 5000


@pytest.mark.parametrize("stiffness", [0.5, 30.0, 2000.0])
def test_margins_are_those_of_python_control(stiffness: float):
    """A mass on a spring and a slow actuator, position fed back: between one and two crossings of each kind."""
    control = pytest.importorskip("control", reason="needs the extra 'control'")
    A = np.array([[0.0, 1.0, 0.0], [-stiffness, -0.3, 1.0], [0.0, 0.0, -2.0]])
    B, C, D = np.array([[0.0], [0.0], [40.0]]), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 1))
    zero, one, units = np.zeros(3), np.zeros(1), Units(("m", "m/s", "N"), ("N",), ("m",))
    model = LinearModel(A, B, C, D, ("q", "v", "F"), ("u",), ("y",), units, zero, one, zero, one)
    gains, phases, _, at_gain, at_phase, _ = control.stability_margins(control.ss(A, B, C, D), returnall=True)
    found = margins(model, 0, 0)
    least = np.argmin(np.abs(np.log(gains)))
    assert (found.gain, 2 * np.pi * found.gain_frequency) == pytest.approx((gains[least], at_gain[least]), rel=1e-6)
    if len(phases):
        least = np.argmin(np.abs(phases))
        assert np.degrees(found.phase) == pytest.approx(phases[least], rel=1e-6)
        assert 2 * np.pi * found.phase_frequency == pytest.approx(at_phase[least], rel=1e-6)
    else:
        assert found.phase == np.inf


@pytest.mark.parametrize(("gain", "high_pass"), [(4e4, False), (3e5, True), (0.4, False), (1.0e-3, True)])
def test_a_margin_beyond_all_modes_is_found_and_drawn(gain: float, high_pass: bool):
    """K/(s + 40) and K s/((s + 40)(s + 5)): a motor from duty to speed crosses one far above its only mode."""
    control = pytest.importorskip("control", reason="needs the extra 'control'")
    A = np.array([[-40.0, 0.0], [1.0, -5.0]])
    B, C = np.array([[gain], [0.0]]), np.array([[1.0, -5.0 if high_pass else 0.0]])
    zero, one, units = np.zeros(2), np.zeros(1), Units(("1", "1"), ("1",), ("1",))
    model = LinearModel(A, B, C, np.zeros((1, 1)), ("a", "b"), ("u",), ("y",), units, zero, one, zero, one)
    _, phases, _, _, at_phase, _ = control.stability_margins(control.ss(A, B, C, np.zeros((1, 1))), returnall=True)
    found = margins(model, 0, 0)
    if not len(phases):
        assert found.phase == np.inf
        return
    least = np.argmin(np.abs(phases))
    assert np.degrees(found.phase) == pytest.approx(phases[least], rel=1e-6)
    assert 2 * np.pi * found.phase_frequency == pytest.approx(at_phase[least], rel=1e-6)
    figure = bode_figure(replace(linear_answer(oscillator(), {}), model=model), [("u", "y")])
    curve = figure.axes[0].lines[0].get_xdata()
    assert curve[0] <= found.phase_frequency <= curve[-1]


def test_what_cannot_be_answered_is_said(tmp_path: Path):
    with pytest.raises(
        OptionError, match="--at force: no state, input or parameter of oscillator - there are v, q, F, m"
    ):
        linear_answer(oscillator(), {"force": 1.0})
    answer = linear_answer(oscillator(), {})
    with pytest.raises(OptionError, match="no input of this name"):
        bode_figure(answer, [("G", "speed")])
    with pytest.raises(OptionError, match=r"no picture format \.foo"):
        save_figure(bode_figure(answer, [("F", "speed")]), tmp_path / "bode.foo")
    with pytest.raises(OptionError, match="does not exist"):
        save_figure(bode_figure(answer, [("F", "speed")]), tmp_path / "no" / "bode.png")
    free = BondGraph("free")
    body = free.one_junction("body", TRANSLATION)
    free.effort_source("push", 3.0, at=body)
    free.inertance("mass", free.parameter("m", 2.0, "kg"), at=body)
    with pytest.raises(DerivationError, match="no point was found where the rates vanish"):
        linear_answer(free, {}, steady=True)
