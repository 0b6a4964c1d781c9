"""Parts of laws in parameters alone, which are computed once for each member, before the filter."""

from __future__ import annotations

import importlib
from collections.abc import Callable

import numpy as np
import pytest
import sympy
from sympy import Expr

import bondgraph as bg

likelihood = importlib.import_module("bondgraph.filter.likelihood").likelihood

#: Laws with a part p of parameters alone that ends in a function which no vector instruction computes.
LAWS: dict[str, Callable[[Expr, Expr, Expr], Expr]] = {
    "quotient to a power": lambda v, c, p: c * v * (sympy.Abs(v) / p) ** 1.5,
    "negative power": lambda v, c, p: c * v * sympy.Abs(v) * p**-0.7,
    "power": lambda v, c, p: c * v + v * p**1.3,
    "logarithm": lambda v, c, p: c * v * sympy.log(1 + p),
    "exponential": lambda v, c, p: c * v * sympy.exp(-p),
    "tangent": lambda v, c, p: c * v * sympy.tan(p),
    "inverse sine": lambda v, c, p: c * v * sympy.asin(p),
    "inverse hyperbolic sine": lambda v, c, p: c * v * sympy.asinh(p),
    "power of a logarithm": lambda v, c, p: c * v * sympy.log(1 + p) ** 1.5,
    "two powers": lambda v, c, p: c * v * p**0.3 + v * sympy.Abs(v) * p**1.7,
}


@pytest.mark.parametrize("method", ["rk4", "ros3p"])
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_compiled_filters_compute_what_numpy_does(law: Callable[[Expr, Expr, Expr], Expr], method: str) -> None:
    """Such a power was never stored where it was the last step of its part: a mass of 80 kg ended on its bound of 100.

    A simulation had it right, and nothing was said.
    """
    g = bg.BondGraph("sled")
    body = g.one_junction("body")
    c, p = g.parameter("c", 3.0, ""), g.parameter("p", 0.4, "")
    g.effort_source("push", g.input("force", ""), at=body)
    g.inertance("mass", g.parameter("m", 2.0, ""), at=body, state="v")
    g.resistance("drag", lambda v: law(v, c, p), at=body)
    g.measure_flow("speed", body)
    model = bg.build(g).model
    time = 0.05 * np.arange(80, dtype=np.float64)
    log = bg.MatchedLog("run", time, 4.0 * np.sin(time)[np.newaxis], np.cos(time)[np.newaxis])
    swept = bg.FilterModel(model, {"v": 0.1}, {"speed": 0.2}, {"v": 1.0}, 2, method=method)
    theta = np.stack([model.theta(p=value) for value in (0.2, 0.4, 0.7)], axis=1)
    fast, plain = (likelihood(swept, log, theta, compiled=way).nll for way in (True, False))
    assert fast == pytest.approx(plain, rel=1e-10) and np.ptp(plain) > 1e-3
