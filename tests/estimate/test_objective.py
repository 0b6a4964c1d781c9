"""Sums over terms: compiled code and plain sums give the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.compile.machine_code import has_numba
from bondgraph.estimate import objective
from bondgraph.estimate.objective import over_terms

pytestmark = pytest.mark.skipif(not has_numba(), reason="compiled kernels need numba")


@given(rows=st.integers(0, 600), count=st.integers(1, 40), across=st.integers(1, 40), seed=st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_compiled_sums_of_products_are_those_of_matrices(rows: int, count: int, across: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    left, right = random.standard_normal((rows, count)), np.asfortranarray(random.standard_normal((rows, across)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(objective, "_MANY_PRODUCTS", 0)
        across_both, own = over_terms(left, right), over_terms(left, left)
    for sums, second in ((across_both, right), (own, left)):
        size = np.outer(np.linalg.norm(left, axis=0), np.linalg.norm(second, axis=0))
        assert (np.abs(sums - left.T @ second) <= 1e-12 * size).all()
    assert (own == own.T).all()
