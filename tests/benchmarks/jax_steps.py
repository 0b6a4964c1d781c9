"""The same Runge-Kutta steps in JAX, from the text of the same generated module, compiled for 16 lanes side by side."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from bondgraph.compile.lanes.load import load_lanes
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import load_compiled
from bondgraph.simulate.model import Model
from tests.benchmarks.cases import RANGER
from tests.benchmarks.likelihood_rows import CALLS
from tests.benchmarks.timing import side_by_side

_STEPS, _STEP = 2000, 1e-5


def against_jax(rounds: int) -> dict[str, float]:
    """Nanoseconds per step and lane in both, on the driveline; inputs held."""
    import jax

    jax.config.update("jax_enable_x64", True)
    model = Model.from_file(RANGER.with_name("driveline.py"))
    x0 = np.repeat(model.x0()[:, np.newaxis], LANES, axis=1)
    theta, u = model.theta(), model.u0()
    rhs = _rhs(model)

    def steps(x: Any) -> Any:
        def one(_: int, x: Any) -> Any:
            k1 = rhs(0.0, x, u, theta)
            k2 = rhs(0.0, x + 0.5 * _STEP * k1, u, theta)
            k3 = rhs(0.0, x + 0.5 * _STEP * k2, u, theta)
            k4 = rhs(0.0, x + _STEP * k3, u, theta)
            return x + _STEP / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)

        return jax.lax.fori_loop(0, _STEPS, one, x)

    compiled = jax.jit(steps)
    lanes, calls = load_lanes(model, stiff=False), load_compiled(CALLS)
    w, clock, inputs, none = lanes.buffer(), np.zeros(2), np.zeros(2 * u.size), np.empty(0)
    rows = w.reshape(-1, LANES)
    rows[lanes.theta : lanes.theta + theta.size] = theta[:, np.newaxis]
    calls.call_prepare(lanes.prepare, w, LANES)

    def ours() -> np.ndarray:
        rows[lanes.x : lanes.x + model.x0().size] = x0
        calls.call_advance(lanes.advance, 0.0, _STEP * _STEPS, _STEPS, 1.0, none, u, u, clock, inputs, w, LANES)
        return rows[lanes.x : lanes.x + model.x0().size].copy()

    theirs = np.asarray(compiled(x0))
    units = _STEPS * LANES
    seconds = side_by_side({"lanes": (ours, units), "JAX": (lambda: compiled(x0).block_until_ready(), units)}, rounds)
    return {
        **{f"ns_per_step_and_lane: {name}": 1e9 * value for name, value in seconds.items()},
        "ratio_vs_jax": seconds["JAX"] / seconds["lanes"],
        "relative_difference": float(np.max(np.abs(theirs - ours()) / (np.abs(theirs) + 1e-9))),
    }


def _rhs(model: Model) -> Any:
    """The right-hand side of a module with JAX's functions in the place of numpy's."""
    import jax.numpy

    text = re.sub(r"^import numpy as np$", "import jax.numpy as np", model.text, flags=re.M)
    namespace: dict[str, Any] = {}
    exec(text, namespace)
    namespace["_stack"] = lambda x, rows: jax.numpy.stack([jax.numpy.broadcast_to(r, x.shape[1:]) for r in rows])
    return namespace["rhs"]
