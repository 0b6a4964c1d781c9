"""Coupled electric drives: two motors turn one belt, which turns a pulley on a spring; a counter sees its speed.

The benchmark CE8. ``start`` is a first-order lag from the sum of the motor voltages to the speed of the pulley. What
the records show beyond it is in ``EFFECTS``, each a function that extends the graph; ``declared(names)`` builds the
graph with some of them and ``corrected`` with those that the training records asked for (``coupled_drives_chain``
repeats the choice).

Speeds alone tell torques only relative to an inertia: that of the drives is set to a plausible 1e-4 kg m^2.

Source of data and machine: T. Wigren, M. Schoukens (2017), *Coupled Electric Drives Data Set and Reference Models*,
Technical Report 2017-024, Uppsala University.
"""

from __future__ import annotations

from collections.abc import Sequence

from sympy import Expr, tanh

from bondgraph.declare.domains import ROTATION
from bondgraph.declare.editing import with_values
from bondgraph.declare.functions import maximum
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_output
from bondgraph.errors import OptionError
from vehicle_graphs.named_effects import Extension, refuse_unknown, with_effects

#: Inertia [kg m^2] that sets the scale of all torques.
DRIVE_INERTIA = 1e-4

#: What the training records asked for, in the order in which they did; ``coupled_drives_chain`` finds it.
CHOSEN = ("squaring_counter", "belt", "cubic_drag", "counter_lag", "counter_bias")
#: The parameters that it then estimates from the training parts of both records.
ESTIMATED = {
    "torque_per_volt": 4.104e-4, "drive_drag": 5.623e-4, "pulley_share": 0.005, "belt_frequency": 24.0885,
    "belt_damping": 2.5873, "pulley_drag": 0.0, "pulley_cubic_drag": 2.77346, "counter_time": 0.030139,
    "counter_offset": 0.052106,
}  # fmt: skip


def start() -> BondGraph:
    """A first-order lag: motor torque against the back-EMF, the counter taken as a plain tachometer.

    Examples
    --------
    >>> [parameter.name for parameter in start().parameters if parameter.bounds]
    ['torque_per_volt', 'drive_drag']
    """
    return declared(())


def rigid() -> BondGraph:
    """The first-order lag again, the pulley drawn as a part of its own on a belt that does not stretch.

    Its inertia depends on that of the drives, so there is one state; a closed loop may put a compliance into the bond.

    Examples
    --------
    >>> [str(bond) for bond in rigid().bonds if bond.target == "pulley"]
    ['drives -> pulley']
    """
    g = declared(())
    pulley = g.one_junction("pulley", ROTATION)
    share = g.parameter("pulley_share", 0.02, "1", "inertia of the pulley over that of the drives")
    g.bond("drives", pulley)
    g.inertance("pulley_inertia", share * symbol("drive_inertia"), at=pulley)
    scale = symbol("pulses_per_radian")
    revise_output(g, "pulse_rate", pulley.flow * scale)
    return g


def corrected() -> BondGraph:
    """The drives with every effect that the training records asked for, at the values estimated from them.

    Examples
    --------
    >>> [output.name for output in corrected().outputs]
    ['pulse_rate']
    """
    return with_values(declared(CHOSEN), ESTIMATED)


def declared(effects: Sequence[str]) -> BondGraph:
    """The drives with the named effects, see ``EFFECTS``.

    Raises
    ------
    OptionError
        If an effect is not known, or contradicts or needs another one.
    """
    g = BondGraph("coupled_drives", doc=__doc__, source="vehicle_graphs/coupled_drives.py")
    voltage = g.input("voltage", "V", "sum of the voltages of both motors", hold=True)

    drives = g.one_junction("drives", ROTATION)
    inertia = g.parameter("drive_inertia", DRIVE_INERTIA, "kg m^2", "both motors with the belt: the scale of torques")
    gain = g.parameter("torque_per_volt", 4e-4, "N m/V", "stall torque of the drives per volt", (4e-5, 4e-3))
    drag = g.parameter("drive_drag", 5e-4, "N m s", "back-EMF and bearings of the drives", (5e-5, 5e-3))
    g.inertance("drive_rotors", inertia, at=drives, state="omega_drives")
    g.effort_source("motors", gain * voltage, at=drives)
    g.resistance("back_emf", drag, at=drives)

    refuse_unknown(g.name, EFFECTS, effects)
    _refuse_impossible(effects)
    with_effects(g, EFFECTS, [name for name in EFFECTS if name in effects])
    g.measure("pulse_rate", _counter(g, effects), "1/s", "counted pulses of the pulley")
    return g


def belt(g: BondGraph) -> None:
    """The elastic belt between the drives and the pulley on its spring: a second inertia and a lightly damped mode."""
    ratio = g.parameter("pulley_share", 0.02, "1", "inertia of the pulley over that of the drives", (0.005, 1.0))
    frequency = g.parameter("belt_frequency", 24.0, "rad/s", "the pulley against held drives", (5.0, 60.0))
    damping = g.parameter("belt_damping", 1.0, "1/s", "damping of the belt over the pulley's inertia", (0.0, 20.0))
    drag = g.parameter("pulley_drag", 1.0, "1/s", "drag of the pulley over its inertia", (0.0, 20.0))
    inertia = ratio * symbol("drive_inertia")
    strand = g.zero_junction("strand", ROTATION)
    stretch = g.one_junction("stretch", ROTATION)
    pulley = g.one_junction("pulley", ROTATION)
    g.bond("drives", strand)
    g.bond(strand, stretch)
    g.compliance("belt", inertia * frequency**2, at=stretch, state="belt_stretch")
    g.resistance("belt_loss", lambda slip: inertia * damping * slip, at=stretch)
    g.bond(strand, pulley)
    g.inertance("pulley_inertia", inertia, at=pulley, state="omega_pulley")
    g.resistance("pulley_bearing", lambda omega: inertia * drag * omega, at=pulley)


def dry_friction(g: BondGraph) -> None:
    """Dry friction of motors and belt."""
    level = g.parameter("drive_friction", 0.0, "N m", "dry friction of the drives", (0.0, 5e-4))
    around = g.parameter("friction_speed", 0.1, "rad/s", "speed at which it reaches 76 %")
    g.resistance("drive_dry_friction", lambda omega: level * tanh(omega / around), at="drives")


def quadratic_drag(g: BondGraph) -> None:
    """Drag of the pulley that grows with the square of its speed."""
    inertia = symbol("pulley_share") * symbol("drive_inertia")
    drag = g.parameter("pulley_quadratic_drag", 0.0, "1", "drag over inertia and speed squared", (0.0, 20.0))
    g.resistance("pulley_air", lambda omega: inertia * drag * omega * abs(omega), at="pulley")


def cubic_drag(g: BondGraph) -> None:
    """Drag of the pulley that grows with the cube of its speed: a damping of its swing that stiffens."""
    inertia = symbol("pulley_share") * symbol("drive_inertia")
    drag = g.parameter("pulley_cubic_drag", 0.0, "s", "drag over inertia and speed cubed", (0.0, 20.0))
    g.resistance("pulley_stiffening_drag", lambda omega: inertia * drag * omega**3, at="pulley")


def uneven_drive(g: BondGraph) -> None:
    """Amplifiers that pull more in one direction than in the other."""
    voltage, gain = symbol("voltage"), symbol("torque_per_volt")
    excess = g.parameter("reverse_excess", 0.0, "1", "additional share of the torque in reverse", (-0.5, 0.5))
    g.effort_source("uneven_motors", -excess * gain * maximum(-voltage, 0), at="drives")


def voltage_bias(g: BondGraph) -> None:
    """Amplifiers that give a voltage at zero command."""
    bias = g.parameter("amplifier_bias", 0.0, "V", "voltage at zero command", (-0.5, 0.5))
    g.effort_source("amplifier_offset", symbol("torque_per_volt") * bias, at="drives")


def absolute_counter(g: BondGraph) -> None:
    """A pulse counter does not see the direction: it gives the absolute value of the speed."""


def squaring_counter(g: BondGraph) -> None:
    """A counter whose reading grows with the square of the speed, blind to the direction."""


def counter_lag(g: BondGraph) -> None:
    """A counter that smooths: first-order lag of its reading."""


def counter_bias(g: BondGraph) -> None:
    """A counter that reads too much by a constant."""


#: Effects that may be added to ``start``, in the order in which a graph declares them.
EFFECTS: dict[str, Extension] = {
    function.__name__: function
    for function in (
        belt, dry_friction, quadratic_drag, cubic_drag, uneven_drive, voltage_bias,
        absolute_counter, squaring_counter, counter_lag, counter_bias,
    )
}  # fmt: skip

_NEEDS = {"quadratic_drag": "belt", "cubic_drag": "belt"}
_EXCLUDES = (("absolute_counter", "squaring_counter"),)


def possible(effects: Sequence[str]) -> bool:
    """Whether effects can be declared together.

    Examples
    --------
    >>> possible(["cubic_drag"]), possible(["belt", "cubic_drag"])
    (False, True)
    """
    needed = all(_NEEDS[name] in effects for name in effects if name in _NEEDS)
    return needed and not any(set(pair) <= set(effects) for pair in _EXCLUDES)


def _refuse_impossible(effects: Sequence[str]) -> None:
    if not possible(effects):
        raise OptionError(
            f"coupled drives: {', '.join(effects)} cannot be declared together - a drag of the pulley needs the belt, "
            "and there is one law of the counter",
            where=tuple(effects),
        )


def _counter(g: BondGraph, effects: Sequence[str]) -> Expr:
    """What the counter reads, as an expression of the speed that it sees."""
    speed = g.signal("seen_speed", symbol(f"flow({'pulley' if 'belt' in effects else 'drives'})"), "rad/s")
    reading = speed * g.parameter("pulses_per_radian", 1.0, "1/rad", "pulses per angle: the scale of speeds")
    if "absolute_counter" in effects:
        reading = abs(reading)
    if "squaring_counter" in effects:
        reading = reading**2 / g.parameter("counter_reference", 1.0, "1/s", "rate at which it reads true")
    if "counter_lag" in effects:
        lag = g.parameter("counter_time", 0.02, "s", "time constant of the counter", (0.002, 0.2))
        reading = g.integral("counted", lambda seen: (reading - seen) / lag, "1/s", "smoothed reading")
    if "counter_bias" in effects:
        reading = reading + g.parameter("counter_offset", 0.0, "1/s", "reading that is always too much", (-0.3, 0.3))
    return reading
