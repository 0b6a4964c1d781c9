"""Coefficients of Rosenbrock methods, for stiff models: linear equations instead of iterations in every step.

With the step h, the Jacobian J = df/dx and the trend T = df/dt at the start of the step (inputs run as straight lines),
stage s solves

    (1/(gamma h) I - J) U_s = f(t + alpha_s h, x + sum_j a_sj U_j) + sum_j c_sj U_j / h + gamma_s h T

and the new state is x + sum m_s U_s.

References
----------
ROS2: Verwer, Spee, Blom and Hundsdorfer (1999), A second-order Rosenbrock method applied to photochemical dispersion
problems, SIAM J. Sci. Comput. 20(4). ROS3P: Lang and Verwer (2001), ROS3P - an accurate third-order Rosenbrock solver
designed for parabolic problems, BIT 41(4). RODAS4: Hairer and Wanner (1996), Solving Ordinary Differential Equations
II, section IV.7 (code RODAS).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray


@dataclass(frozen=True)
class Tableau:
    """Coefficients of one method: lower triangles ``a`` and ``c`` row by row, the others one per stage."""

    name: str
    order: int
    gamma: float
    alpha: tuple[float, ...]
    gammas: tuple[float, ...]
    a: tuple[tuple[float, ...], ...]
    c: tuple[tuple[float, ...], ...]
    m: tuple[float, ...]

    @property
    def stages(self) -> int:
        """Number of stages."""
        return len(self.alpha)

    def is_new(self, s: int) -> bool:
        """Whether stage ``s`` needs slopes at a point other than that of the stage before it."""
        if s == 0 or self.alpha[s] != self.alpha[s - 1]:
            return True
        return [*self.a[s]] != [*self.a[s - 1], 0.0]

    @functools.cached_property
    def numbers(self) -> FloatArray:
        """All coefficients in the order in which compiled kernels read them."""
        numbers = [float(self.stages), self.gamma]
        for s in range(self.stages):
            numbers += [self.alpha[s], self.gammas[s], self.m[s], float(self.is_new(s))]
            for row in (self.a[s], self.c[s]):
                numbers += [*row, *(0.0,) * (self.stages - len(row))]
        return np.array(numbers)


_G2 = 1.0 - math.sqrt(0.5)  # the smaller of the two that make it L-stable has the smaller error

ROS2 = Tableau(
    name="ros2",
    order=2,
    gamma=_G2,
    alpha=(0.0, 1.0),
    gammas=(_G2, -_G2),
    a=((), (1.0 / _G2,)),
    c=((), (-2.0 / _G2,)),
    m=(1.5 / _G2, 0.5 / _G2),
)

_G = 0.5 + math.sqrt(3.0) / 6.0

ROS3P = Tableau(
    name="ros3p",
    order=3,
    gamma=_G,
    alpha=(0.0, 1.0, 1.0),
    gammas=(_G, _G - 1.0, 0.5 - 2.0 * _G),
    a=((), (1.0 / _G,), (1.0 / _G, 0.0)),
    c=((), (-1.0 / _G**2,), (-(_G**2 + 2.0 * _G - 0.5) / _G**3, (0.5 - 2.0 * _G) / _G**2)),
    m=((1.0 + (2.0 - 0.5 / _G) / (3.0 * _G)) / _G, (2.0 / 3.0 - 1.0 / (6.0 * _G)) / _G, 1.0 / (3.0 * _G)),
)

_A5 = (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950)

RODAS4 = Tableau(
    name="rodas4",
    order=4,
    gamma=0.25,
    alpha=(0.0, 0.386, 0.21, 0.63, 1.0, 1.0),
    gammas=(0.25, -0.1043, 0.1035, -0.03620000000000023, 0.0, 0.0),
    a=(
        (),
        (1.544,),
        (0.9466785280815826, 0.2557011698983284),
        (3.314825187068521, 2.896124015972201, 0.9986419139977817),
        _A5,
        (*_A5, 1.0),
    ),
    c=(
        (),
        (-5.6688,),
        (-2.430093356833875, -0.2063599157091915),
        (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
        (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160),
        (8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054),
    ),
    m=(*_A5, 1.0, 1.0),
)

#: Stiff methods by name.
TABLEAUS: dict[str, Tableau] = {tableau.name: tableau for tableau in (ROS2, ROS3P, RODAS4)}
