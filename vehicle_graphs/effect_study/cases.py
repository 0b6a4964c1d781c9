"""The cases of a study: what is missing in the simulated machine, how large it is, and which chance is taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from bondgraph.errors import OptionError, suggest
from vehicle_graphs.effect_study.machine import Kind, StudyMachine

Family = Literal["effect", "none", "fault", "part", "pair", "masking", "outside", "relative"]
FAMILIES: tuple[Family, ...] = get_args(Family)
Noise = Literal["white", "coloured", "heavy"]

#: The machine without an effect: its parameters as declared, off by the machine's spread, and under other noises.
NOTHING: tuple[tuple[str, Noise], ...] = (
    ("as declared", "white"),
    ("other parameters", "white"),
    ("coloured noise", "coloured"),
    ("heavy tails", "heavy"),
)
#: Families beside the main one are made with this size, in standard deviations of the sensor.
CLEAR = 3.0
DESCRIPTIONS: dict[Family, str] = {
    "effect": "one effect",
    "none": "no effect",
    "fault": "a fault of a sensor",
    "part": "an effect in part of the data",
    "pair": "two effects",
    "masking": "two effects that mask each other",
    "outside": "an effect taken out of the dictionary with its relatives",
    "relative": "an effect taken out of the dictionary, its relatives left",
}


@dataclass(frozen=True)
class Case:
    """One simulated machine to close the loop on.

    ``subject`` names the effects by their labels, joined by `` + ``, or for the family ``none`` one of
    :data:`NOTHING`. ``size`` is what the fitted declared model leaves, in standard deviations of a sensor,
    see :mod:`vehicle_graphs.effect_study.generate`.
    """

    family: Family
    subject: str
    size: float
    seed: int

    @property
    def name(self) -> str:
        """A name for its file.

        Examples
        --------
        >>> Case("pair", "slip at belt + quadratic_loss at body", 3.0, 4).name
        'pair-slip_at_belt+quadratic_loss_at_body-3-004'
        """
        subject = self.subject.replace(" + ", "+").replace("->", "to").replace(" ", "_")
        return f"{self.family}-{subject}-{self.size:g}-{self.seed:03d}"

    @property
    def noise(self) -> Noise:
        """The kind of sensor noise."""
        return dict(NOTHING)[self.subject] if self.family == "none" else "white"

    @property
    def exact_parameters(self) -> bool:
        """Whether the true parameters are the declared ones."""
        return self.family == "none" and self.subject == NOTHING[0][0]

    def kinds(self, machine: StudyMachine) -> tuple[Kind, ...]:
        """The effects in the simulated machine."""
        if self.family == "none":
            return ()
        pairs = {"pair": machine.pairs, "masking": machine.masking}.get(self.family)
        if pairs is not None:
            return next(pair for pair in pairs if _joined(pair) == self.subject)
        return (machine.kind(self.subject),)

    def missing_functions(self, machine: StudyMachine) -> tuple[str, ...]:
        """Effect functions that are taken out of the dictionary."""
        if self.family not in ("outside", "relative"):
            return ()
        (kind,) = self.kinds(machine)
        return (kind.name, *(kind.relatives if self.family == "outside" else ()))


def all_cases(
    machine: StudyMachine,
    families: Sequence[Family],
    subjects: Sequence[str],
    sizes: Sequence[float],
    seeds: int,
    first: int = 0,
) -> list[Case]:
    """The cases of a study, all kinds once before any of them a second time, so that a part of them tells something.

    Parameters
    ----------
    machine
        The machine.
    families
        Families of cases.
    subjects
        Effects by label; none: all of the machine.
    sizes
        Sizes of the effects in the family ``effect``; the others take :data:`CLEAR`.
    seeds
        Cases of each kind and size. Without an effect each variant takes two and a half times as many, so that ten
        seeds make a hundred.
    first
        The first seed. Whoever changes the loop while looking at some seeds can judge it by others.

    Raises
    ------
    OptionError
        If the machine has no such effect, or there are no such seeds.
    """
    if seeds < 1 or first < 0:
        raise OptionError(f"{seeds} seeds from {first} on - take one or more, from 0 or later on", where=("seeds",))
    known = [kind.label for kind in (*machine.kinds, *machine.faults)]
    for label in subjects:
        if label not in known:
            raise OptionError(f"{machine.name}: no effect {label!r}{suggest(label, known)}", where=(label,))
    found: list[Case] = []
    for seed in range(first, first + seeds):
        for size in sizes:
            found += _of_family(machine, "effect", size, seed) if "effect" in families else []
        for family in FAMILIES[1:]:
            found += _of_family(machine, family, CLEAR, seed) if family in families else []
    if "none" in families:
        for seed in range(first + seeds, first + (5 * seeds + 1) // 2):
            found += _of_family(machine, "none", 0.0, seed)
    return [case for case in found if not subjects or case.family == "none" or case.subject in subjects]


def _of_family(machine: StudyMachine, family: Family, size: float, seed: int) -> list[Case]:
    if family == "none":
        return [Case(family, name, 0.0, seed) for name, _ in NOTHING]
    subjects = {
        "effect": [kind.label for kind in machine.kinds],
        "fault": [kind.label for kind in machine.faults],
        "part": [kind.label for kind in machine.kinds if kind.in_part],
        "pair": [_joined(pair) for pair in machine.pairs],
        "masking": [_joined(pair) for pair in machine.masking],
        "outside": [kind.label for kind in machine.kinds if kind.outside],
        "relative": [kind.label for kind in machine.kinds if kind.relatives],
    }[family]
    return [Case(family, subject, size, seed) for subject in subjects]


def _joined(pair: tuple[Kind, ...]) -> str:
    return " + ".join(kind.label for kind in pair)
