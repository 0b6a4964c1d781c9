"""Geometry of a mechanical rubber-belt CVT: the belt of fixed length and the flyweights on their ramp.

Neither has a closed form, so both are computed where a graph is declared and enter it as smooth tables.

Sources: length and wrap angles of an open belt are textbook geometry (Budynas, Nisbett, *Shigley's Mechanical
Engineering Design*, chapter 17); the flyweight force follows from virtual work.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bondgraph.errors import DeclarationError

FloatArray = npt.NDArray[np.float64]


def rounded(values: FloatArray) -> list[float]:
    """Computed lengths and ratios to 12 decimals, so that a declaration is the same number on every machine.

    Examples
    --------
    >>> rounded(np.array([0.1 + 0.2]))
    [0.3]
    """
    return [round(float(value), 12) for value in np.atleast_1d(values)]


# ---------------------------------------------------------------------- belt of fixed length


@dataclass(frozen=True)
class BeltGeometry:
    """Two sheave pairs and the belt around them; lengths in m, the angle in rad.

    ``smallest_primary`` and ``largest_primary`` bound the effective radii of the primary that are asked for.

    Raises
    ------
    DeclarationError
        If no belt can lie so: pulleys overlap, or the belt is shorter than the way around the small ones.

    Examples
    --------
    >>> belt = BeltGeometry(centre_distance=0.231, belt_length=0.864, smallest_primary=0.0246, largest_primary=0.075)
    >>> float(secondary_radius(belt, np.array(0.0246)).round(4))
    0.0962
    """

    centre_distance: float
    belt_length: float
    smallest_primary: float
    largest_primary: float

    def __post_init__(self) -> None:
        if not 0.0 < self.smallest_primary < self.largest_primary < self.centre_distance:
            raise DeclarationError(
                f"belt: primary radii {self.smallest_primary:.4g} .. {self.largest_primary:.4g} m must be positive, "
                f"increase and stay below the centre distance {self.centre_distance:.4g} m - pulleys cannot overlap",
                where=("belt",),
            )
        for radius in (self.smallest_primary, self.largest_primary):
            shortest = float(open_belt_length(self, radius, 0.0))
            longest = float(open_belt_length(self, radius, self.centre_distance))
            if not shortest < self.belt_length < longest:
                raise DeclarationError(
                    f"belt: length {self.belt_length:.4g} m does not close around a primary of {radius:.4g} m at "
                    f"centre distance {self.centre_distance:.4g} m ({shortest:.4g} .. {longest:.4g} m would) - "
                    "correct one of them",
                    where=("belt",),
                )


def wrap_angles(belt: BeltGeometry, primary: Any, secondary: Any) -> tuple[FloatArray, FloatArray]:
    """Arcs of contact [rad] on the primary and on the secondary, for effective radii [m] of any shape."""
    lean = np.arcsin((np.asarray(secondary) - np.asarray(primary)) / belt.centre_distance)
    return np.asarray(np.pi - 2 * lean), np.asarray(np.pi + 2 * lean)


def open_belt_length(belt: BeltGeometry, primary: Any, secondary: Any) -> FloatArray:
    """Length [m] of a belt around two pulleys of given effective radii [m]."""
    primary, secondary = np.asarray(primary, dtype=float), np.asarray(secondary, dtype=float)
    around_primary, around_secondary = wrap_angles(belt, primary, secondary)
    span = np.sqrt(belt.centre_distance**2 - (secondary - primary) ** 2)
    return np.asarray(2 * span + around_primary * primary + around_secondary * secondary)


def secondary_radius(belt: BeltGeometry, primary: Any) -> FloatArray:
    """Secondary radius [m] for which the belt keeps its length, by Newton's method.

    The length grows with either radius by its wrap angle, so the iteration is exact after a few steps.
    """
    primary = np.asarray(primary, dtype=float)
    secondary = np.full_like(primary, (belt.belt_length - 2 * belt.centre_distance) / np.pi) - primary
    secondary = np.clip(secondary, 1e-3, 0.9 * belt.centre_distance)
    for _ in range(20):
        error = open_belt_length(belt, primary, secondary) - belt.belt_length
        secondary = secondary - error / wrap_angles(belt, primary, secondary)[1]
    return np.asarray(secondary)


# ---------------------------------------------------------------------- flyweights on a ramp


@dataclass(frozen=True)
class FlyweightRamp:
    """Arms that pivot on a shoulder of one sheave and press a roller outwards against a ramp of the other; m, rad.

    The ramp is a straight part up to ``corner`` and a parabola beyond: its height, measured inwards from
    ``cage_radius``, is ``height(z) = c0 + c1 z + c2 z^2`` with the coefficients of ``straight`` and ``curved``. The
    axial coordinate z starts at the end of the ramp, which lies ``offset`` from the pivot when the clutch is open.

    Raises
    ------
    DeclarationError
        If a length is not positive, the ramp does not meet itself at the corner, or the ramp does not fall (the
        weights would then pull the sheaves apart).
    """

    pivot_radius: float
    arm_length: float
    roller_radius: float
    cage_radius: float
    offset: float
    corner: float
    straight: tuple[float, float]
    curved: tuple[float, float, float]

    def __post_init__(self) -> None:
        for name in ("pivot_radius", "arm_length", "roller_radius", "cage_radius", "offset"):
            if not getattr(self, name) > 0:
                raise DeclarationError(f"flyweight ramp: {name} {getattr(self, name):.4g} m must be positive", (name,))
        step = np.polyval(self.curved[::-1], self.corner) - np.polyval(self.straight[::-1], self.corner)
        if abs(step) > 1e-6:
            raise DeclarationError(
                f"flyweight ramp: its two parts miss each other by {step:.3g} m at the corner {self.corner:.4g} m - "
                "correct their coefficients",
                where=("corner",),
            )
        if self.straight[1] >= 0 or self.curved[1] + 2 * self.curved[2] * self.corner >= 0:
            raise DeclarationError(
                "flyweight ramp: the height must fall along the ramp - a roller driven outwards would open the clutch",
                where=("straight", "curved"),
            )


def roller_path(ramp: FlyweightRamp, axial: Any) -> tuple[FloatArray, FloatArray]:
    """Radius [m] of the roller's centre and its slope [1] along the ramp coordinate ``axial`` [m] of the centre.

    The centre follows the parallel curve of the ramp; around the corner, which points towards the roller, an arc.
    """
    axial = np.asarray(axial, dtype=float)
    first = np.arctan(-ramp.straight[1])
    straight_radius = (
        ramp.cage_radius - ramp.straight[0] - ramp.straight[1] * axial - ramp.roller_radius / np.cos(first)
    )
    contact = axial - ramp.roller_radius * np.sin(np.arctan(-ramp.curved[1]))
    for _ in range(30):
        steepness = -(ramp.curved[1] + 2 * ramp.curved[2] * contact)
        contact = axial - ramp.roller_radius * np.sin(np.arctan(steepness))
    height = ramp.curved[0] + contact * (ramp.curved[1] + contact * ramp.curved[2])
    curved_radius = ramp.cage_radius - height - ramp.roller_radius * np.cos(np.arctan(steepness))

    last = np.arctan(-(ramp.curved[1] + 2 * ramp.curved[2] * ramp.corner))
    beside = np.clip((axial - ramp.corner) / ramp.roller_radius, np.sin(first), np.sin(last))
    at_corner = ramp.straight[0] + ramp.straight[1] * ramp.corner
    corner_radius = ramp.cage_radius - at_corner - ramp.roller_radius * np.sqrt(1 - beside**2)

    before = axial < ramp.corner + ramp.roller_radius * np.sin(first)
    after = axial > ramp.corner + ramp.roller_radius * np.sin(last)
    radius = np.where(before, straight_radius, np.where(after, curved_radius, corner_radius))
    slope = np.where(before, np.tan(first), np.where(after, steepness, beside / np.sqrt(1 - beside**2)))
    return radius, slope


def flyweight_motion(ramp: FlyweightRamp, travel: Any) -> tuple[FloatArray, FloatArray]:
    """Radius r [m] of the flyweights and their lift dr/dx [1] at a sheave travel x [m].

    Closing the sheaves by x moves the ramp past the roller: the centre stands at ``offset - L cos(angle) + x`` along
    the ramp and at the radius ``pivot + L sin(angle)``. Virtual work of the centrifugal force then gives the axial
    force ``m r omega^2 dr/dx`` of a mass m at the roller, whatever the contact force is (frictionless).

    Raises
    ------
    DeclarationError
        If the arm does not reach the ramp at some travel.
    """
    travel = np.asarray(travel, dtype=float)
    angle = np.zeros_like(travel)
    for _ in range(40):
        path, slope = roller_path(ramp, ramp.offset - ramp.arm_length * np.cos(angle) + travel)
        miss = ramp.pivot_radius + ramp.arm_length * np.sin(angle) - path
        gradient = ramp.arm_length * (np.cos(angle) - slope * np.sin(angle))
        angle = np.clip(angle - miss / gradient, -1.2, 1.2)
    if not np.all(np.abs(miss) < 1e-9):
        worst = float(travel.flat[int(np.argmax(np.abs(miss)))])
        raise DeclarationError(
            f"flyweight ramp: the arm of {ramp.arm_length:.4g} m does not reach the ramp at {worst:.4g} m of travel - "
            "correct arm, pivot, cage or offset",
            where=("arm_length",),
        )
    radius = ramp.pivot_radius + ramp.arm_length * np.sin(angle)
    return radius, slope / (1 - slope * np.tan(angle))
