"""Linear models as state-space systems of python-control, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from bondgraph.derive.linearisation import LinearModel, Units
from bondgraph.errors import DerivationError, require_kind
from bondgraph.exchange.libraries import library


def to_control(model: LinearModel) -> Any:
    """The ``control.StateSpace`` of a linear model: deviations from its operating point, with the names of the model.

    Raises
    ------
    GenerationError
        If python-control is not installed.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("car")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("engine", g.input("F", "N"), at=body)
    >>> _ = g.inertance("mass", 800.0, at=body, state="v")
    >>> _ = g.resistance("aero", lambda v: 0.4 * v**2, at=body)
    >>> g.measure_flow("speed", body)
    >>> system = to_control(bg.linearise(bg.build(g), x={"v": 20.0}))
    >>> system.poles().tolist(), system.input_labels, system.output_labels
    ([(-0.02+0j)], ['F'], ['speed'])
    >>> bool(abs(system.dcgain() - 0.0625) < 1e-12)
    True
    """
    require_kind("to_control", model, LinearModel, "linear model")
    control = library("control", "control")
    return control.ss(
        model.A, model.B, model.C, model.D,
        states=list(model.states), inputs=list(model.inputs), outputs=list(model.outputs),
    )  # fmt: skip


def from_control(system: Any, units: Units | None = None) -> LinearModel:
    """The linear model of a continuous ``control.StateSpace``, at an operating point of zeros.

    Parameters
    ----------
    system
        Of any tool of python-control; a transfer function is realised first.
    units
        Of states, inputs and outputs; dimensionless where omitted.

    Raises
    ------
    DerivationError
        If the system is one of sampled times.
    GenerationError
        If python-control is not installed.
    """
    control = library("control", "control")
    if system.isdtime(strict=True):
        raise DerivationError(
            f"the system has samples every {system.dt} s, and a linear model here runs in continuous time - convert it "
            "first, with control.d2c or from the continuous original",
            where=("dt",),
        )
    found = control.ss(system)
    n_x, n_u, n_y = found.nstates, found.ninputs, found.noutputs
    states, inputs, outputs = (
        tuple(map(str, labels)) for labels in (found.state_labels, found.input_labels, found.output_labels)
    )
    return LinearModel(
        np.asarray(found.A, float), np.asarray(found.B, float), np.asarray(found.C, float), np.asarray(found.D, float),
        states, inputs, outputs, units or Units(("1",) * n_x, ("1",) * n_u, ("1",) * n_y),
        np.zeros(n_x), np.zeros(n_u), np.zeros(n_x), np.zeros(n_y),
    )  # fmt: skip
