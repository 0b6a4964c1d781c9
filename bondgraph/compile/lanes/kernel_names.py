"""Names that lane kernels use before they exist: every printed module defines them itself.

Kernels import them for the type checker only.
"""

from __future__ import annotations

from collections.abc import Callable

from bondgraph.arrays import FloatArray

#: ``rates(clock, inputs, w, n)``, and the same for ``slopes`` and ``factor``
rates: Callable[[FloatArray, FloatArray, FloatArray, int], None]
slopes: Callable[[FloatArray, FloatArray, FloatArray, int], None]
factor: Callable[[FloatArray, FloatArray, FloatArray, int], None]

#: The step of the method at hand: ``_rk4_step`` or ``_rosenbrock_step``.
one_step: Callable[..., None]

#: ``push(seed, w, n)``
push: Callable[[FloatArray, FloatArray, int], None]

#: ``push_step(seed, clock, w, n)`` and ``push_state(clock, w, n)``
push_step: Callable[[FloatArray, FloatArray, FloatArray, int], None]
push_state: Callable[[FloatArray, FloatArray, int], None]

#: ``substitute(w, n)`` and ``curve(w, n)``
substitute: Callable[[FloatArray, int], None]
curve: Callable[[FloatArray, int], None]

#: Stage arithmetic of Runge-Kutta steps, see ``stages``: ``begin(w, n)``, ``first`` and ``inner(weight, reach, w, n)``
begin: Callable[[FloatArray, int], None]
first: Callable[[float, float, FloatArray, int], None]
inner: Callable[[float, float, FloatArray, int], None]
last: Callable[[float, FloatArray, int], None]

#: And of Rosenbrock steps.
reach: Callable[[FloatArray, int, int, FloatArray, int], None]
right: Callable[[FloatArray, int, int, int, float, FloatArray, int], None]
keep: Callable[[int, FloatArray, int], None]
finish: Callable[[FloatArray, int, FloatArray, int], None]

#: And of directions, with ``keep_slopes(s, w, n)``.
begin_direction: Callable[[FloatArray, int], None]
bring_direction: Callable[[FloatArray, FloatArray, int], None]
turn_direction: Callable[[float, float, FloatArray, FloatArray, int], None]
take_direction: Callable[[FloatArray, FloatArray, int], None]
finish_direction: Callable[[FloatArray, int], None]
keep_slopes: Callable[[int, FloatArray, int], None]
