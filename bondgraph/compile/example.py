"""A small generated module, for examples and first trials."""

from __future__ import annotations

PENDULUM = '''"""Pendulum with viscous drag, driven by a torque per unit of inertia."""
import numpy as np

NAME = "pendulum"
FORMAT = "bondgraph-module/1"
# name, unit, initial value, meaning
STATES = (
    ("angle", "rad", 0.5, "deflection from hanging down"),
    ("rate", "rad/s", 0.0, "angular velocity"),
)
# name, unit, default, between samples, letters, meaning
INPUTS = (
    ("drive", "rad/s^2", 0.0, "linear", None, "driving torque per inertia"),
)
# name, unit, value, lower, upper, meaning
PARAMETERS = (
    ("length", "m", 1.0, 0.2, 5.0, "pivot to bob"),
    ("damping", "1/s", 0.1, 0.0, 2.0, "drag per inertia"),
    ("gravity", "m/s^2", 9.81, None, None, "standard value"),
)
# name, unit, meaning
OUTPUTS = (
    ("deflection", "m", "horizontal position of the bob"),
)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    angle = x[0]
    rate = x[1]
    drive = u[0]
    length = theta[0]
    damping = theta[1]
    gravity = theta[2]
    restoring = gravity/length*np.sin(angle)
    dx1 = drive - damping*rate - restoring
    return _stack(x, (rate, dx1))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    angle = x[0]
    length = theta[0]
    return _stack(x, (length*np.sin(angle),))


def _stack(x, rows):
    """Rows broadcast to the batch of x, shape (n, *batch)."""
    result = np.empty((len(rows),) + x.shape[1:])
    for i, row in enumerate(rows):
        result[i] = row
    return result
'''
