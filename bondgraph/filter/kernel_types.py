"""What the filter kernel reads, writes and works on."""

from __future__ import annotations

from typing import NamedTuple

from bondgraph.arrays import FloatArray, IntArray


class Log(NamedTuple):
    """A log on its nodes: time (n,); u (n, n_u); u_left, u_right (n-1, n_u); y (n, n_y); the rest (n-1,).

    Integration steps between nodes and their grading; seconds of process noise that enter before and after.
    """

    time: FloatArray
    u: FloatArray
    u_left: FloatArray
    u_right: FloatArray
    y: FloatArray
    substeps: IntArray
    grading: FloatArray
    noise_start: FloatArray
    noise_end: FloatArray


class Robustness(NamedTuple):
    """A loss in place of half a square: its kind (0: none) and numbers, see :mod:`bondgraph.filter.kernel_robust`.

    ``constant`` is what its norm adds to that of a Gaussian, nats per value.
    """

    kind: int
    first: float
    second: float
    constant: float


class Rules(NamedTuple):
    """Numbers of the sigma points and of the method, and where vectors are in the work buffer of the model.

    ``appended`` holds the positions of the appended parameters in theta, ``pivot_floor`` the share of a pivot that is
    rounding; ``tableau`` the coefficients of a stiff method, empty for Runge-Kutta; ``theta``, ``x``, ``y`` the first
    rows of these vectors in the buffer of ``lanes`` lanes; ``robust`` the loss of innovations.
    """

    spread: float
    weight: float
    correction: float
    pivot_floor: float
    appended: IntArray
    tableau: FloatArray
    lanes: int
    n_x: int
    theta: int
    x: int
    y: int
    robust: Robustness


class Members(NamedTuple):
    """Numbers of each member, the last axis: theta, x0 (n_x), and covariances.

    ``initial_lower`` (n_s, n_s) is a lower factor, ``process_cov`` (n_s, n_s) per second, ``noise_cov`` (n_y, n_y).
    """

    theta: FloatArray
    x0: FloatArray
    initial_lower: FloatArray
    process_cov: FloatArray
    noise_cov: FloatArray


class Part(NamedTuple):
    """The samples ``begin <= k < end`` of a log, and the beliefs with which members come to a part and leave it.

    ``mean`` (n_s, members) and the lower factor ``lower`` (n_s, n_s, members) are read unless the part is the first and
    written unless it is the last; where it is both they may be empty.
    """

    begin: int
    end: int
    mean: FloatArray
    lower: FloatArray


class Verdicts(NamedTuple):
    """Per member: negative log-likelihood, code of the outcome, index of the last finished sample, floored pivots.

    Between the parts of a log they are those of the samples so far.
    """

    nll: FloatArray
    outcome: IntArray
    last: IntArray
    floored: IntArray


class Alone(NamedTuple):
    """Scratch of a member by itself: that of :class:`Work` without its last axis, empty for several members.

    ``upper`` has room for the transpose of a factor.
    """

    mean: FloatArray
    cov: FloatArray
    lower: FloatArray
    points: FloatArray
    outputs: FloatArray
    shift: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray
    joint: FloatArray
    upper: FloatArray
    channels: IntArray


class Work(NamedTuple):
    """Scratch of one thread; the last axis of the first part is the lane.

    The belief: mean (n_s, L), cov and its lower factor (n_s, n_s, L). Points (2 n_s + 1, n_s, L) and their outputs
    (2 n_s + 1, n_y, L). ``residual`` and ``log_scale`` (n_y, L) serve robust
    measurements. Per lane: likelihood so far, floored pivots, code of a failure, and whose numbers it has. The
    model's own: ``buffer``, ``clock`` (2,), ``inputs`` (2 n_u,). ``alone`` shares the memory of the belief.
    """

    mean: FloatArray
    cov: FloatArray
    lower: FloatArray
    points: FloatArray
    outputs: FloatArray
    shift: FloatArray
    slopes: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray
    joint: FloatArray
    innovation: FloatArray
    residual: FloatArray
    log_scale: FloatArray
    nll: FloatArray
    pivot: FloatArray
    floored: IntArray
    code: IntArray
    who: IntArray
    channels: IntArray
    buffer: FloatArray
    clock: FloatArray
    inputs: FloatArray
    alone: Alone
