"""Made-up results for the report's tests: a coast-down with a forgotten aerodynamic drag."""

from __future__ import annotations

import numpy as np

from bondgraph.estimate.objective import TraceRow
from bondgraph.report.html import Located, Provenance, ReportData
from bondgraph.report.series import (
    ChannelSeries,
    Coefficient,
    FloatArray,
    FoundEffect,
    MissingEffort,
    ParameterChange,
    Prediction,
    Tried,
    channel_errors,
)
from tests.report.samples import two_mass_driveline


def coast(drag: float, time: FloatArray) -> FloatArray:
    """Speed under constant and quadratic deceleration, closed form of dv/dt = -a - drag v^2 (or -a where drag is 0)."""
    a, v0 = 0.35, 20.0
    if drag == 0.0:
        return np.maximum(v0 - a * time, 0.0)
    root = np.sqrt(a / drag)
    return np.maximum(root * np.tan(np.arctan(v0 / root) - np.sqrt(a * drag) * time), 0.0)


def coast_down_series(samples: int = 2400) -> tuple[ChannelSeries, ...]:
    """Two channels in a training and a held-out log; missing measurements in one of them."""
    found = []
    for seed, log in enumerate(("coast_down_1", "coast_down_2")):
        draw = np.random.default_rng(seed)
        time = np.linspace(0.0, 30.0, samples)
        truth = coast(2.2e-3, time)
        for channel, unit, factor, noise in (("velocity", "m/s", 1.0, 0.05), ("wheel_speed", "rad/s", 3.2, 0.4)):
            measured = factor * truth + noise * draw.standard_normal(samples)
            if channel == "wheel_speed":
                measured[samples // 3 : samples // 2] = np.nan
            nominal, corrected = factor * coast(0.0, time), factor * coast(2.15e-3, time)
            before = Prediction(measured + 0.1 * (nominal - measured), nominal)
            after = Prediction(factor * truth + noise * 0.1, corrected)
            found.append(ChannelSeries(log, channel, unit, time, measured, before, after, noise, held_out=seed == 1))
    return tuple(found)


def missing_drag() -> MissingEffort:
    draw = np.random.default_rng(7)
    speed = draw.uniform(0.0, 20.0, 3000)
    law_x = np.linspace(0.0, 20.0, 60)
    return MissingEffort(
        "missing force at body", "v of body [m/s]", "missing force [N]",
        speed, 0.55 * speed**2 + 25.0 * draw.standard_normal(3000),
        law_x, 0.56 * law_x**2, "c·v·|v|, c = 0.56 kg/m", 0.52 * law_x**2, 0.60 * law_x**2,
    )  # fmt: skip


def coast_down_report() -> ReportData:
    """A report in which every part is filled."""
    series = coast_down_series()
    drawing = two_mass_driveline()
    return ReportData(
        "coast_down",
        "effect found",
        "A force growing with the square of the speed is missing at the body; it explains 98 % of the residual.",
        effects=(
            FoundEffect(
                "quadratic loss", "body_drag", "load", "F = c_drag·v·|v|",
                (Coefficient("c_drag", 0.55873, "kg/m", (0.5184, 0.5991)),),
                (("gain of log-likelihood", "1290 nats"), ("p-value over 21 candidates", "< 0.0001")),
                "Resistance of the air, quadratic in speed.",
            ),
        ),
        errors=channel_errors(series),
        series=series,
        drawing=drawing,
        added=frozenset({"drag"}),
        missing=(missing_drag(),),
        located=(Located("load", "effort", 3e-12, 0.98), Located("motor", "effort", 0.21, 0.04)),
        alternatives=(
            Tried("quadratic loss", "load", 1290.4, "largest gain, confirmed by the block-wise variance", chosen=True),
            Tried("viscous loss", "load", 1211.0, "79 nats less", indistinguishable=False),
            Tried("headwind", "load", 1288.9, "1.5 nats less: steady wind would separate them", indistinguishable=True),
            Tried("added inertia", "motor", 3.2, "not significant after correction for 21 tries"),
        ),
        parameters=(
            ParameterChange("m_load", "kg", 260.0, 258.73, (255.9, 261.5), meaning="vehicle with driver"),
            ParameterChange("k_shaft", "N m/rad", 4200.0, 8000.0, (5200.0, 8000.0), True, "half shaft"),
        ),
        trace=tuple(TraceRow("swarm", i, 40 * i, 500 * 0.9**i + 100, ()) for i in range(30)),
        notes=("The road was taken as level: a constant slope would look like rolling resistance.",),
        made=Provenance(
            "bondgraph close-loop /models/coast.py:car --data=/data/coast_down_1.csv --holdout coast_down_2.csv",
            3, (("bondgraph", "0.1.0"), ("numpy", "2.4.6")), ("coast_down_1",), ("coast_down_2",), 84.2,
        ),
    )  # fmt: skip
