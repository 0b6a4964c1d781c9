"""Simulate many members at once with fixed steps: compiled, or the same in numpy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray, IntArray, count_members, member_columns
from bondgraph.compile.lanes.load import load_lanes
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import has_numba, load_translated
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.errors import OptionError
from bondgraph.simulate import batch_kernel
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.integrators import RK4
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.stiff import ModelEquations, Rosenbrock
from bondgraph.simulate.task import Inputs, Task, refuse_modes
from bondgraph.simulate.trajectory import BatchTrajectory


def simulate_batch(
    model: Model,
    time: npt.ArrayLike,
    inputs: Inputs = None,
    theta: npt.ArrayLike | None = None,
    x0: npt.ArrayLike | None = None,
    *,
    method: str | Rosenbrock = "rk4",
    substeps: int = 1,
    compiled: bool = True,
) -> BatchTrajectory:
    """Integrate many members at once with fixed steps; members differ in parameters or initial state.

    Parameters
    ----------
    model, time, inputs
        As for :func:`bondgraph.simulate.simulation.simulate`; the inputs are the same for all members.
    theta, x0
        Shape (n_theta,) or (n_theta, members), and (n_x,) or (n_x, members); None: declared values.
    method
        ``"rk4"``, ``"ros2"``, ``"ros3p"`` or ``"rodas4"``, or a stiff integrator with its own steps.
    substeps
        Steps between neighbouring times (and break points of the inputs).
    compiled
        Use the compiled kernel; without numba, or with False, numpy gives the same results.

    Returns
    -------
    BatchTrajectory
        A member that diverged is NaN after its end; the others are not touched by it.

    Raises
    ------
    ModelError, OptionError
        If names, shapes or options are wrong.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> model = pendulum()
    >>> lengths = np.stack([model.theta(length=length) for length in (0.5, 1.0, 2.0)], axis=1)
    >>> simulate_batch(model, np.linspace(0.0, 1.0, 11), theta=lengths, substeps=4).x.shape
    (2, 11, 3)
    """
    if substeps < 1:
        raise OptionError(f"substeps={substeps}: at least one step is needed between two times")
    refuse_modes(model)
    task = Task.of(model, time, inputs, theta, x0)
    members = count_members((task.theta, task.x0))
    parameters = member_columns("theta", task.theta, len(model.parameters), members)
    start = member_columns("x0", task.x0, len(model.states), members)
    grid = np.union1d(task.times, task.signal.break_points(task.times[0], task.times[-1]))
    if isinstance(method, Rosenbrock):
        integrator: RK4 | Rosenbrock = method
    else:
        integrator = RK4(substeps) if method == "rk4" else Rosenbrock(method, substeps)
    run = _in_kernel if compiled and has_numba() else _in_numpy
    x, y, last = run(task, grid, parameters, start, integrator)
    if not np.array_equal(grid, task.times):
        chosen = np.searchsorted(grid, task.times)
        x, y = x[:, chosen], y[:, chosen]
    outcomes = tuple(Outcome.OK if end == grid.size - 1 else Outcome.DIVERGED for end in last)
    return BatchTrajectory(model, task.times, x, y, outcomes, grid[np.maximum(last, 0)])


def _in_numpy(
    task: Task, grid: FloatArray, theta: FloatArray, start: FloatArray, integrator: RK4 | Rosenbrock
) -> tuple[FloatArray, FloatArray, IntArray]:
    """All members in one array; states, outputs and the index of each member's last finite sample."""
    rhs = ModelEquations(task.model, theta)
    x = np.empty((start.shape[0], grid.size, start.shape[1]))
    x[:, 0] = start
    left, right = task.signal.intervals(grid)
    state = integrator.init(float(grid[0]), start)
    with np.errstate(all="ignore"):
        for k in range(1, grid.size):
            segment = InputSegment(float(grid[k - 1]), float(grid[k]), left[:, k - 1], right[:, k - 1])
            values, state = integrator.step(rhs, segment, grid[k : k + 1], state)
            x[:, k] = values[:, 0]
    finite = np.logical_and.accumulate(np.isfinite(x).all(axis=0), axis=0)
    x[:, ~finite] = np.nan
    u = task.signal.at(grid)[:, :, np.newaxis]
    y = task.model.output(grid[:, np.newaxis], x, u, theta)
    y[:, ~finite] = np.nan
    return x, y, finite.sum(axis=0) - 1


def _in_kernel(
    task: Task, grid: FloatArray, theta: FloatArray, start: FloatArray, integrator: RK4 | Rosenbrock
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The same in the compiled kernel, sixteen members side by side."""
    n_x, members = start.shape
    n_y, n_u = len(task.model.outputs), len(task.model.inputs)
    x = np.full((n_x, grid.size, members), np.nan)
    x[:, 0] = start
    y = np.full((n_y, grid.size, members), np.nan)
    last = np.empty(members, dtype=np.int64)
    left, right = (np.ascontiguousarray(values.T) for values in task.signal.intervals(grid))
    stiff = isinstance(integrator, Rosenbrock)
    tableau = TABLEAUS[integrator.method].numbers if isinstance(integrator, Rosenbrock) else np.empty(0)
    grading = integrator.grading if isinstance(integrator, Rosenbrock) else 1.0
    u = np.ascontiguousarray(task.signal.at(grid).T)
    samples = batch_kernel.Grid(grid, u, left, right, integrator.substeps, grading, tableau)
    lanes = load_lanes(task.model, stiff)
    scratch = batch_kernel.Scratch(lanes.buffer(), np.zeros(2), np.zeros(2 * n_u), LANES, lanes.theta, lanes.x, lanes.y)
    equations = batch_kernel.Equations(lanes.prepare, lanes.advance, lanes.measure)
    load_translated("simulate_members", batch_kernel)(
        equations, samples, np.ascontiguousarray(theta), x, y, last, scratch
    )
    return x, y, last
