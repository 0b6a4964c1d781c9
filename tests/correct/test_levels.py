"""How innovations respond to noise levels: the compiled recursion is that of Joseph's form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.compile.machine_code import has_numba
from bondgraph.data.log import FloatArray
from bondgraph.filter.linear import level_kernel
from bondgraph.filter.linear.levels import carry

pytestmark = pytest.mark.skipif(not has_numba(), reason="compiled kernels need numba")


def a_filter(seed: int, size: int, outputs: int, count: int, drivers: int = 2) -> level_kernel.Filter:
    """A Kalman filter of random linear equations, with channels left out at random."""
    draw = np.random.default_rng(seed)
    seen = (draw.random((count, outputs)) < 0.8).astype(np.float64)
    transition = np.linalg.qr(draw.standard_normal((count - 1, size, size)))[0]
    slope = draw.standard_normal((count, outputs, size)) * seen[:, :, np.newaxis]
    gain, whitener = np.zeros((count, size, outputs)), np.zeros((count, outputs, outputs))
    noise = np.diag(0.1 + draw.random(outputs))
    cov = np.eye(size)
    for k in range(count):
        if k:
            cov = transition[k - 1] @ cov @ transition[k - 1].T + 0.1 * np.eye(size)
        own = np.ix_(np.flatnonzero(seen[k]), np.flatnonzero(seen[k]))
        shown = slope[k] @ cov @ slope[k].T + noise
        whitener[k][own] = np.linalg.inv(np.linalg.cholesky(shown[own]))
        gain[k] = cov @ slope[k].T @ whitener[k].T @ whitener[k]
        left = np.eye(size) - gain[k] @ slope[k]
        cov = left @ cov @ left.T + gain[k] @ noise @ gain[k].T
    innovation = draw.standard_normal((count, outputs)) * seen
    whitened = np.einsum("kab,kb->ka", whitener, innovation)
    driven = draw.standard_normal((count - 1, drivers, size, 2))
    gathered = driven @ np.swapaxes(driven, 2, 3)
    return level_kernel.Filter(transition, gathered, slope, seen, gain, whitener, innovation, whitened)


def by_joseph(filtered: level_kernel.Filter, process: FloatArray, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives (n, n_y) by one level, from the formulas as they are written down."""
    count, outputs, size = filtered.slope.shape
    moved, spread = np.zeros(size), np.zeros((size, size))
    slopes_z, slopes_s = np.zeros((count, outputs)), np.zeros((count, outputs))
    for k in range(count):
        if k:
            across = filtered.transition[k - 1]
            moved = across @ moved
            spread = across @ spread @ across.T + np.einsum("dij,d->ij", filtered.gathered[k - 1], process)
        shown, gain, whitener = filtered.slope[k], filtered.gain[k], filtered.whitener[k]
        own = np.diag(noise * filtered.seen[k])
        change = whitener @ (shown @ spread @ shown.T + own) @ whitener.T
        half = np.tril(change, -1) + 0.5 * np.diag(np.diag(change))
        slopes_z[k] = -whitener @ shown @ moved - half @ filtered.whitened[k]
        slopes_s[k] = 0.5 * np.diag(change)
        left = np.eye(size) - gain @ shown
        turned = (left @ spread @ shown.T - gain @ own) @ whitener.T @ whitener @ filtered.innovation[k]
        moved = moved - gain @ shown @ moved + turned
        spread = left @ spread @ left.T + gain @ own @ gain.T
    return slopes_z, slopes_s


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 6), outputs=st.integers(1, 4), levels=st.integers(1, 5))
def test_the_recursion_is_that_of_josephs_form(seed: int, size: int, outputs: int, levels: int) -> None:
    filtered = a_filter(seed, size, outputs, 30)
    draw = np.random.default_rng(seed + 1)
    process, noise = draw.random((2, levels)), draw.random((outputs, levels))
    slopes_z, slopes_s = np.empty((30, outputs, levels)), np.empty((30, outputs, levels))
    carry(filtered, process, noise, slopes_z, slopes_s)
    for level in range(levels):
        z, s = by_joseph(filtered, process[:, level], noise[:, level])
        np.testing.assert_allclose(slopes_z[:, :, level], z, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(slopes_s[:, :, level], s, rtol=1e-8, atol=1e-9)


def test_it_stays_the_same_over_a_long_log() -> None:
    """What rounding leaves between a covariance and its transpose once grew until nothing was a number."""
    filtered = a_filter(3, 5, 2, 20000)
    process, noise = np.eye(2), np.eye(2)
    slopes_z, slopes_s = np.empty((20000, 2, 2)), np.empty((20000, 2, 2))
    carry(filtered, process, noise, slopes_z, slopes_s)
    z, s = by_joseph(filtered, process[:, 1], noise[:, 1])
    np.testing.assert_allclose(slopes_z[:, :, 1], z, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(slopes_s[:, :, 1], s, rtol=1e-8, atol=1e-9)
