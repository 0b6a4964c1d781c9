"""Changes of the model passed on through the linearised filter, from sample to sample: see :mod:`.response`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.compile.machine_code import has_numba, load_translated
from bondgraph.data.log import FloatArray
from bondgraph.filter.linear import response_kernel
from bondgraph.filter.linear.response import Change, LinearLog


def respond(linear: LinearLog, change: Change, at: Sequence[int] = ()) -> tuple[FloatArray, FloatArray]:
    """Changes of the whitened innovations per unit of each change, and of the filtered states at some samples.

    Returns
    -------
    tuple
        Shape (n_y * n, lanes), rows by output, then sample, as the terms of an estimation problem; and
        (at, n_x, lanes).
    """
    found: FloatArray = np.empty(change.outputs.shape)
    states = respond_into(found, 0, linear, change, at)
    return found.reshape(-1, found.shape[2]), states


def respond_into(found: FloatArray, lane: int, linear: LinearLog, change: Change, at: Sequence[int] = ()) -> FloatArray:
    """As :func:`respond`, into (n_y, n, all lanes) from a lane on; the shifts of the states at increasing samples."""
    still = np.zeros((linear.slope.shape[2], change.outputs.shape[2]))
    begun = still if change.begun is None else change.begun.copy()
    return _carried(linear, change, 0, begun, at, found, lane)


def decay(linear: LinearLog, sample: int) -> FloatArray:
    """Response (n_y * n, n_x) of the innovations to a unit shift of each filtered state after a sample."""
    count, outputs, size = linear.slope.shape
    found = np.zeros((outputs, count, size))
    _carried(linear, None, sample + 1, np.eye(size), (), found, 0)
    return found.reshape(-1, size)


def _carried(
    linear: LinearLog,
    change: Change | None,
    first: int,
    moved: FloatArray,
    at: Sequence[int],
    found: FloatArray,
    lane: int,
) -> FloatArray:
    """The recursion from a sample on, given the state's shift after the sample before it."""
    if not has_numba():
        return _in_numpy(linear, change, first, moved, at, found[:, :, lane : lane + moved.shape[1]])
    filtered = response_kernel.Filter(
        *map(
            np.ascontiguousarray,
            (linear.transition, linear.early, linear.late, linear.slope, linear.gain, linear.whitener),
        )
    )
    states = np.zeros((len(at), *moved.shape))
    expected = np.zeros((filtered.slope.shape[1], moved.shape[1]))
    load_translated("carried", response_kernel)(
        filtered, _shifts(change), first, moved, np.asarray(at, dtype=np.int64), found, lane, states,
        np.zeros_like(moved), expected,
    )  # fmt: skip
    return states


def _shifts(change: Change | None) -> response_kernel.Shifts:
    """A change as the kernel takes it: with the rows in which it is one."""
    if change is None:
        none, still = np.zeros(0, dtype=np.int64), np.zeros((0, 0, 0))
        return response_kernel.Shifts(still, still, still, none, none)
    start, end, outputs = map(np.ascontiguousarray, (change.start, change.end, change.outputs))
    moving = np.flatnonzero(start.any(axis=(1, 2)) | end.any(axis=(1, 2)))
    return response_kernel.Shifts(start, end, outputs, moving, np.flatnonzero(outputs.any(axis=(1, 2))))


def _in_numpy(
    linear: LinearLog, change: Change | None, first: int, moved: FloatArray, at: Sequence[int], found: FloatArray
) -> FloatArray:
    """The same without a compiler."""
    states = np.zeros((len(at), *moved.shape))
    for k in range(first, found.shape[1]):
        if k:
            moved = linear.transition[k - 1] @ moved
        if k and change is not None:
            moved += linear.early[k - 1] @ change.start[:, k - 1] + linear.late[k - 1] @ change.end[:, k - 1]
        expected = linear.slope[k] @ moved + (0.0 if change is None else change.outputs[:, k])
        found[:, k] = -(linear.whitener[k] @ expected)
        moved = moved - linear.gain[k] @ expected
        if k in at:
            states[list(at).index(k)] = moved
    return states
