"""Words of statistics, explained on a page where they first stand."""

from __future__ import annotations

import re

#: Beginning of the names of formulas, see :class:`bondgraph.correct.shapes.formula.Formula`.
_FORMULA = "formula_"

#: How a word is found in a text, how it is shown, and what it means.
_WORDS = (
    (
        r"\bNLL\b|negative log-likelihood", "negative log-likelihood (NLL)",
        "how little the model expects the measured log; smaller is better",
    ),
    (
        r"\bnats\b", "nat",
        "unit of log-likelihood: with 3 nats more the same data are 20 times as likely",
    ),
    (
        r"\bNIS\b", "NIS",
        "square of the innovation over the variance that the filter expects of it: 1 in the mean where model and "
        "noise are right",
    ),
    (
        r"\binnovations?\b", "innovation",
        "a measurement less what the filter expected just before it",
    ),
    (
        r"\bcoloured\b|\bwhiteness\b", "coloured, white",
        "innovations that follow from those before them are coloured: something is left to explain. White ones do "
        "not; the p of the whiteness is the chance of so much colour in white ones",
    ),
    (
        r"\bp-values?\b|\bp, |\(p [<=]", "p",
        "chance of an answer at least so clear if there were nothing to find; small is evidence",
    ),
    (
        r"block-robust", "block-robust",
        "by the scatter between blocks of time, so that errors that last do not count as many",
    ),
    (
        r"transfer (to|by)|\bfolds?\b", "transfer",
        "gain in parts (folds) of the training data from which the effect was not estimated",
    ),
    (
        r"[Pp]rocess noise", "process noise",
        "what moves states at random beside the inputs",
    ),
    (
        r"\bheld[- ]out\b|\bHeld[- ]out\b", "held-out log",
        "a log that decides nothing of a model and shows how it predicts",
    ),
)  # fmt: skip


class Words:
    """The explanations of one page: each word is explained once, where it is first used.

    Examples
    --------
    >>> words = Words()
    >>> words("it gains 101 nats")
    [('nat', 'unit of log-likelihood: with 3 nats more the same data are 20 times as likely')]
    >>> words("2 nats")
    []
    """

    def __init__(self) -> None:
        self._told: set[str] = set()

    def __call__(self, *texts: str) -> list[tuple[str, str]]:
        """Words of some texts that were not explained before, each with what it means."""
        text = "\n".join(texts)
        found = [(word, meaning) for form, word, meaning in _WORDS if re.search(form, text) and word not in self._told]
        self._told |= {word for word, _ in found}
        return found


def law_at(name: str, place: str) -> str:
    """A law at its place, and where it acts if that is not everywhere.

    Examples
    --------
    >>> law_at("leakage where pressure of tank is above a level", "tank"), law_at("leakage", "tank")
    ('leakage at tank where pressure of tank is above a level', 'leakage at tank')
    """
    law, where, regime = name.partition(" where ")
    return f"{law_title(law)} at {place}{where}{regime}"


def told_apart_by(separate: str) -> str:
    """A sentence on what would tell two laws apart, by :class:`bondgraph.correct.advice.Separation`.

    Examples
    --------
    >>> told_apart_by("a sensor of the flow of pipe (correlation 0.412)")
    'A sensor of the flow of pipe (correlation 0.412) would tell them apart.'
    >>> told_apart_by("none of the sensors and manoeuvres that were tried would separate them")
    'None of the sensors and manoeuvres that were tried would separate them.'
    """
    said = f"{separate[:1].upper()}{separate[1:]}"
    return f"{said}." if separate.startswith("none of") else f"{said} would tell them apart."


def law_title(label: str) -> str:
    """The name of a law, or its label ``NAME at PLACE``, as prose shows it: of a formula its terms in words.

    Examples
    --------
    >>> law_title("formula_ramp_below_of_flow_of_strut at strut"), law_title("coulomb_loss at carriage")
    ('formula (ramp below of flow of strut) at strut', 'coulomb_loss at carriage')
    """
    name, at, place = label.partition(" at ")
    terms = name.removeprefix(_FORMULA)
    return label if terms == name else f"formula ({terms.replace('_', ' ')}){at}{place}"
