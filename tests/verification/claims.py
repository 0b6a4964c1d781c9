"""Claims: one published result each, what the toolkit gives for it, and how far apart they may be.

A claim names the functions of the toolkit that it is about. Whether they ran is watched while it is answered, so that a
claim which computes its answer by other means is not counted as one that holds.
"""

from __future__ import annotations

import enum
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Function = Callable[..., Any]


@dataclass(frozen=True)
class Published:
    """One case of the file, with the folder of its data."""

    folder: Path
    record: dict[str, Any]

    def __getitem__(self, key: str) -> Any:
        return self.record[key]

    def table(self, name: str | None = None) -> npt.NDArray[Any]:
        """The data file as columns by name."""
        return np.genfromtxt(self.folder / (name or self.record["data"]), delimiter=",", names=True)


def published(folder: Path) -> dict[str, Published]:
    """Every published case by its id."""
    cases = json.loads((folder / "cases.json").read_text(encoding="utf-8"))["cases"]
    return {case["id"]: Published(folder, case) for case in cases}


@dataclass(frozen=True)
class Tolerance:
    """How far a value may be off: an absolute part plus a share of what is expected."""

    absolute: float = 0.0
    relative: float = 0.0

    def of(self, expected: Floats) -> Floats:
        """Allowed difference of each value."""
        return self.absolute + self.relative * np.abs(expected)

    def __str__(self) -> str:
        parts = [f"{self.absolute:.3g}"] * (self.absolute > 0.0) + [f"{self.relative:.3g} rel."] * (self.relative > 0.0)
        return " + ".join(parts) or "exact"


class Answer(NamedTuple):
    """What is expected and what the toolkit gives; shapes must broadcast."""

    expected: npt.ArrayLike
    got: npt.ArrayLike


@dataclass(frozen=True)
class Claim:
    """A published result to be met.

    Parameters
    ----------
    case
        Id in the file of cases.
    about
        The quantity.
    covers
        Keys of ``expected`` in the file; empty where that is one text.
    where
        Functions of the toolkit that give the answer.
    answer
        Computes it; None with a ``reason`` why the toolkit cannot.
    tolerance
        From the case: what the publication states, else why this much is right stands at the claim.
    reason
        Why the published computation cannot be expressed; an answer is then shown, and not judged.
    slow
        Takes more than about ten seconds.
    """

    case: str
    about: str
    where: tuple[Function, ...] = ()
    answer: Callable[[Published], Answer] | None = None
    tolerance: Callable[[Published], Tolerance] = lambda _: Tolerance()
    covers: tuple[str, ...] = ()
    reason: str = ""
    slow: bool = False

    @property
    def name(self) -> str:
        """Case and quantity."""
        return f"{self.case}: {self.about}"


def within(key: str, kind: str = "absolute") -> Callable[[Published], Tolerance]:
    """The tolerance that the case states under a key."""
    return lambda case: Tolerance(**{kind: float(case["tol"][key])})


def own(absolute: float = 0.0, relative: float = 0.0) -> Callable[[Published], Tolerance]:
    """A tolerance of this project's, where the case states none for a quantity."""
    return lambda _: Tolerance(absolute, relative)


class Verdict(enum.Enum):
    """How a claim stands."""

    HOLDS = "agrees"
    DIFFERS = "differs"
    NOT_CALLED = "the toolkit was not asked"
    NOT_EXPRESSIBLE = "not expressible"


@dataclass(frozen=True)
class Row:
    """One line of the table: the value that is furthest off, over what it may be."""

    claim: Claim
    source: str
    verdict: Verdict
    values: int = 0
    expected: float = float("nan")
    got: float = float("nan")
    tolerance: str = ""

    @property
    def where(self) -> tuple[str, ...]:
        """Dotted paths in the toolkit."""
        return tuple(f"{function.__module__}.{function.__qualname__}" for function in self.claim.where)

    def to_dict(self) -> dict[str, Any]:
        """The line as JSON holds it."""

        def number(value: float) -> float | None:
            return value if np.isfinite(value) else None

        return {
            "case": self.claim.case,
            "about": self.claim.about,
            "source": self.source,
            "values": self.values,
            "expected": number(self.expected),
            "got": number(self.got),
            "difference": number(self.got - self.expected),
            "tolerance": self.tolerance,
            "where": list(self.where),
            "verdict": self.verdict.value,
            "reason": self.claim.reason,
        }


def answered(claim: Claim, cases: dict[str, Published]) -> Row:
    """The line of a claim."""
    case = cases[claim.case]
    if claim.answer is None:
        return Row(claim, case["source"], Verdict.NOT_EXPRESSIBLE)
    with _watched(claim.where) as missing:
        answer = claim.answer(case)
    expected, got = np.broadcast_arrays(np.asarray(answer.expected, float), np.asarray(answer.got, float))
    tolerance = claim.tolerance(case)
    allowed = tolerance.of(expected)
    differences = np.abs(got - expected)
    holds = bool(np.all(differences <= allowed))  # false for what is not a number
    verdict = Verdict.HOLDS if holds else Verdict.DIFFERS
    if claim.reason:
        verdict = Verdict.NOT_EXPRESSIBLE
    elif missing:
        verdict = Verdict.NOT_CALLED
    share = np.divide(differences, allowed, out=np.where(differences > 0.0, np.inf, 0.0), where=allowed > 0.0)
    worst = int(np.argmax(np.where(np.isnan(share), np.inf, share)))
    shown = float(expected.flat[worst]), float(got.flat[worst])
    return Row(claim, case["source"], verdict, expected.size, *shown, str(tolerance))


@contextmanager
def _watched(functions: Sequence[Function]) -> Iterator[set[CodeType]]:
    """The functions that have not run yet, until the block ends; watching ends with the last of them."""
    missing = {function.__code__ for function in functions}

    def watch(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code in missing:
            missing.discard(frame.f_code)
            if not missing:
                sys.setprofile(None)

    before = sys.getprofile()
    sys.setprofile(watch if missing else before)
    try:
        yield missing
    finally:
        sys.setprofile(before)
