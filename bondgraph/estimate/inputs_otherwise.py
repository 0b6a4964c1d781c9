"""Inputs that are likelier another way between samples than declared, as an estimate tells it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bondgraph.text import few, inflected, number

#: How inputs run between samples: in a sentence, as declared, and as an option says it.
_WORDS: Mapping[str, tuple[str, str, str, str]] = {
    "hold": ("held", "straight lines", "with hold=True", "held"),
    "linear": ("straight", "held", "without hold", "linear"),
    "band limited": ("band limited", "straight lines", "with between='band limited'", "band"),
}


@dataclass(frozen=True)
class InputsOtherwise:
    """Inputs that run another way between samples, ``nats`` likelier than as declared.

    ``way`` is ``hold``, ``linear`` or ``band limited``; ``in_pieces`` is true where the logs show all of them constant
    in pieces.
    """

    names: tuple[str, ...]
    way: str
    in_pieces: bool
    nats: float = 0.0

    @property
    def sentence(self) -> str:
        """The gain, and what to declare.

        Examples
        --------
        >>> InputsOtherwise(("force",), "hold", True, 41.3).sentence
        'between samples, force is 41.3 nats likelier held than straight lines, and it is constant in pieces: declare it
        with hold=True (--inputs-between force=held) and estimate again - what acts late in a machine looks like that
        too'
        """
        now, before, declared, option = _WORDS[self.way]
        verb, pronoun = inflected(self.names, "is", "are"), inflected(self.names, "it", "them")
        pieces = f", and {inflected(self.names, 'it is', 'they are')} constant in pieces" if self.in_pieces else ""
        options = " ".join(f"--inputs-between {name}={option}" for name in self.names)
        late = " - what acts late in a machine looks like that too" if self.way == "hold" else ""
        return (
            f"between samples, {few(self.names)} {verb} {number(self.nats)} nats likelier {now} than {before}{pieces}: "
            f"declare {pronoun} {declared} ({options}) and estimate again{late}"
        )

    def to_dict(self) -> dict[str, Any]:
        """The same as values of JSON."""
        return {"inputs": list(self.names), "way": self.way, "nats": self.nats}
