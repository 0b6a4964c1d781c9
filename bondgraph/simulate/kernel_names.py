"""Names that kernels use before they exist: the scalar functions of a model, which every compiled module holds itself.

Kernels import them for the type checker only; :func:`bondgraph.simulate.compile.load_kernels` joins the texts.
"""

from __future__ import annotations

from collections.abc import Callable

from bondgraph.simulate.arrays import FloatArray

#: ``rhs_into(t, x, u, theta, dx)``
rhs_into: Callable[[float, FloatArray, FloatArray, FloatArray, FloatArray], None]

#: ``output_into(t, x, u, theta, y)``
output_into: Callable[[float, FloatArray, FloatArray, FloatArray, FloatArray], None]
