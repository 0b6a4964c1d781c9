"""Counts, rates with their intervals, and the tables of a study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any, get_args

import numpy as np
from scipy import stats

from vehicle_graphs.effect_study.cases import DESCRIPTIONS, FAMILIES, NOTHING
from vehicle_graphs.effect_study.scoring import Answer, Outcome

ANSWERS: tuple[Answer, ...] = get_args(Answer)
#: Title, columns and rows of a table.
Table = tuple[str, Sequence[str], Sequence[Sequence[str]]]
#: An effect counts as of three times the noise from here on: sizes are met within a tenth.
CLEARLY = 2.7


def rate(hits: int, runs: int, exact: bool = False) -> dict[str, Any]:
    """How often, of how many, and the 95 % interval: Wilson's, or that of Clopper and Pearson.

    Examples
    --------
    >>> known = rate(0, 100, exact=True)
    >>> round(known["low"], 4), round(known["high"], 4)
    (0.0, 0.0362)
    """
    if not runs:
        return {"hits": 0, "runs": 0}
    found = stats.binomtest(hits, runs).proportion_ci(method="exact" if exact else "wilson")
    return {"hits": hits, "runs": runs, "share": hits / runs, "low": float(found.low), "high": float(found.high)}


def share(outcomes: Sequence[Outcome], is_hit: Callable[[Outcome], bool], exact: bool = False) -> dict[str, Any]:
    """The rate of outcomes that are hits."""
    return rate(sum(map(is_hit, outcomes)), len(outcomes), exact)


def said(one: dict[str, Any]) -> str:
    """A rate as a person reads it.

    Examples
    --------
    >>> said(rate(19, 20))
    '19/20 = 95 % (76 to 99 %)'
    """
    if not one["runs"]:
        return "no runs"
    low, high = 100.0 * one["low"], 100.0 * one["high"]
    return f"{one['hits']}/{one['runs']} = {100.0 * one['share']:.0f} % ({low:.0f} to {high:.0f} %)"


def result(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """All tables as values, for ``result.json``."""
    main = [one for one in outcomes if one.family == "effect"]
    sizes = sorted({one.size for one in main})
    return {
        "runs": len(outcomes),
        "one_effect": {
            "by_kind": {
                subject: {
                    f"{size:g}": share([o for o in main if (o.subject, o.size) == (subject, size)], is_right)
                    for size in sizes
                }
                for subject in dict.fromkeys(one.subject for one in main)
            },
            "by_size": {f"{size:g}": _summary([o for o in main if o.size == size]) for size in sizes},
            "left_three_times_the_noise": _summary([o for o in main if o.largest_left >= CLEARLY]),
            "shown_three_times_the_noise": _summary([o for o in main if o.largest_shown >= CLEARLY]),
        },
        "no_effect": nothing(outcomes),
        "others": {
            family: {"runs": len(own), **_counted(own)}
            for family in FAMILIES[2:]
            if (own := [one for one in outcomes if one.family == family])
        },
        "confusion": confusion(main),
        "cases": [one.written() for one in outcomes],
    }


def is_right(one: Outcome) -> bool:
    """Whether all true effects were named, or their groups, and nothing else."""
    return one.is_right


def _places_right(one: Outcome) -> bool:
    return bool(one.hits) and all(hit.place_right for hit in one.hits)


def _summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Rates over cases with one effect."""
    covered = [hit.covered for one in outcomes for hit in one.hits if hit.covered is not None]
    return {
        "right": share(outcomes, is_right),
        "effect": share(outcomes, lambda one: all(hit.is_right for hit in one.hits)),
        "place": share(outcomes, _places_right),
        "answers": dict(Counter(hit.answer for one in outcomes for hit in one.hits)),
        "group_size": _mean(len(hit.group) for one in outcomes for hit in one.hits if hit.is_right),
        "with_another_beside": sum(bool(one.extra) for one in outcomes),
        "coverage": rate(sum(covered), len(covered)),
        "held_out_nll_gain": _middle(o.before["nll"] - o.after["nll"] for o in outcomes if o.before),
        "held_out_error_before": _middle(_worst(o.before) for o in outcomes if o.before),
        "held_out_error_after": _middle(_worst(o.after) for o in outcomes if o.after),
        "processor_seconds": _middle(o.processor_seconds for o in outcomes),
    }


def _worst(errors: dict[str, float]) -> float:
    return max(value for name, value in errors.items() if name != "nll")


def _middle(values: Iterable[float]) -> float | None:
    known = list(values)
    return float(np.median(known)) if known else None


def _mean(values: Iterable[int]) -> float | None:
    known = list(values)
    return float(np.mean(known)) if known else None


def nothing(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """False alarms by variant of the machine without an effect, and over all."""
    own = [one for one in outcomes if one.family == "none"]
    groups = {name: [one for one in own if one.subject == name] for name, _ in NOTHING} | {"all": own}
    return {
        name: {
            "false_alarm": share(group, lambda one: bool(one.found), exact=True),
            "called_unexplained": share(group, lambda one: one.verdict == "unexplained residual", exact=True),
            "failed": sum(bool(one.failure) for one in group),
        }
        for name, group in groups.items()
        if group
    }


def kind_of_answer(one: Outcome) -> str:
    """What was said of effects that the dictionary may not hold, in words."""
    if one.failure:
        return "failed"
    if one.is_right:
        return "right"
    if one.found:
        part = "one of two" if len(one.hits) > 1 and any(hit.is_right for hit in one.hits) else ""
        where = "another effect at its place" if _places_right(one) else "another effect elsewhere"
        beside = "right, and another beside it"
        return part or (beside if all(hit.is_right for hit in one.hits) else where)
    if one.verdict == "unexplained residual":
        if not one.unexplained:
            return "unexplained, no place"
        return "unexplained at its place" if one.unexplained_right else "unexplained elsewhere"
    return "none"


def _counted(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """What was said in each of the other families; where two effects act, each counts in ``each``."""
    return {
        "right": share(outcomes, is_right),
        "each": rate(sum(hit.is_right for o in outcomes for hit in o.hits), sum(len(o.hits) for o in outcomes)),
        "said": dict(Counter(map(kind_of_answer, outcomes)).most_common()),
    }


def confusion(outcomes: Sequence[Outcome]) -> dict[str, dict[str, int]]:
    """What was said (an effect by its label, or that nothing or something unknown is missing) of every true effect."""
    table: dict[str, Counter[str]] = {}
    for one in outcomes:
        for hit in one.hits:
            table.setdefault(hit.label, Counter())[hit.found or hit.answer] += 1
    return {label: dict(counts.most_common()) for label, counts in table.items()}


def text(outcomes: Sequence[Outcome]) -> str:
    """The tables for a terminal."""
    parts = [_text(*one) if one[2] else one[0] for one in all_tables(outcomes)]
    return "\n\n".join([*parts, *failures(outcomes)])


def failures(outcomes: Sequence[Outcome]) -> list[str]:
    """Sentences on cases that failed."""
    counted = Counter(one.failure for one in outcomes if one.failure)
    return [f"failed {count} times: {why}" for why, count in counted.most_common()]


def all_tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """Title, columns and rows of every table; a title without rows is a sentence."""
    found = result(outcomes)
    tables: list[Table] = []
    if any(one.family == "effect" for one in outcomes):
        tables += [*_main_tables(found["one_effect"]), _instead(found["confusion"])]
    if found["no_effect"]:
        rows = [
            (name, said(one["false_alarm"]), said(one["called_unexplained"]), str(one["failed"]))
            for name, one in found["no_effect"].items()
        ]
        tables.append(("no effect (intervals of Clopper and Pearson)",
                       ("machine", "an effect is named", "called unexplained", "failed"), rows))  # fmt: skip
    rows = [
        (DESCRIPTIONS[family], said(one["right"]), said(one["each"]), _listed(one["said"]))
        for family, one in found["others"].items()
    ]
    if rows:
        tables.append(("other cases", ("missing", "all right", "each right", "said"), rows))
    return tables


def _main_tables(found: dict[str, Any]) -> list[Table]:
    sizes = list(found["by_size"])
    rows = [
        (subject, *(f"{one['hits']}/{one['runs']}" for one in (by[size] for size in sizes)))
        for subject, by in found["by_kind"].items()
    ]
    rows.append(("all", *(said(found["by_size"][size]["right"]) for size in sizes)))
    head = "one effect, by its size over the noise that a fit of the declared model leaves: right effect and place, or"
    first: Table = (f"{head} their group, and nothing else named", ("missing", *sizes), rows)
    clear = {
        **{f"left {size}": found["by_size"][size] for size in sizes},
        "left at least 3": found["left_three_times_the_noise"],
        "shown at least 3": found["shown_three_times_the_noise"],
    }
    rates = [
        (
            name, said(one["right"]), said(one["effect"]), said(one["place"]), _listed(one["answers"]),
            _number(one["group_size"]), str(one["with_another_beside"]), said(one["coverage"]),
        )
        for name, one in clear.items()
    ]  # fmt: skip
    columns = (
        "size", "right", "effect or group", "place or group", "answers", "mean group", "another beside",
        "interval holds",
    )  # fmt: skip
    keys = ("held_out_error_before", "held_out_error_after", "held_out_nll_gain", "processor_seconds")
    middles = [(name, *(_number(one[key]) for key in keys)) for name, one in clear.items()]
    heads = ("size", "held-out error / noise before", "after", "held-out gain, nats", "processor seconds")
    return [first, ("over all kinds", columns, rates), ("medians", heads, middles)]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _instead(found: dict[str, dict[str, int]]) -> Table:
    rows = [
        (label, _listed({other: count for other, count in counts.items() if other != label}))
        for label, counts in found.items()
        if set(counts) - {label}
    ]
    return ("said instead" if rows else "said instead: nothing", ("missing", "said"), rows)


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def _text(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[k]) for row in (columns, *rows)) for k in range(len(columns))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in (columns, *rows)]
    return "\n".join([title, *(f"  {line}".rstrip() for line in lines)])
