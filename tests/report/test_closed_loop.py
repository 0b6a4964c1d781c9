"""What a terminal is told of a closed loop."""

from __future__ import annotations

from dataclasses import replace

from bondgraph.report.closed_loop import summary
from tests.report.examples import coast_down_report


def test_coefficients_are_told_with_their_units_and_intervals() -> None:
    data = coast_down_report()
    assert "c_drag = 0.559 kg/m [0.518, 0.599]" in summary(data)
    (effect,) = data.effects
    share = replace(effect.coefficients[0], name="share", value=0.0272, unit="1", ci95=(0.0259, 0.0284))
    bare = replace(data, effects=(replace(effect, coefficients=(share,)),))
    assert "share = 0.0272 [0.0259, 0.0284]" in summary(bare)
