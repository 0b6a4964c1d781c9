"""Formulas as candidates of a round: made where a free function explains more than any law, refitted as every law is.

A function without a law (:mod:`bondgraph.correct.places.unexplained`) says where something is missing and of which
signals it is a function; only there terms of the library are tried. What the linearised filter singles out of their
sums is refitted in the model, judged with the number of all sums that were tried, and offered beside the laws of the
dictionary. A wrong relative of the truth no longer wins by being the only one. While a law of the dictionary passes,
a formula of a single term is offered against it, since two laws at two places may look like one sum at one place.

Reference for search in the region where a model fails, with an exact test of what is found: Ribeiro et al. (2026),
library-based inference of structure-dependent dynamics (LISDD).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import BuiltModel
from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import choose
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.places.located import LocatedAt
from bondgraph.correct.places.probes import Probe, Signal
from bondgraph.correct.places.unexplained import Spline, distinct, splines, unexplained
from bondgraph.correct.scores.scoring import Linearisation, Scored
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.shapes.completions import arguments
from bondgraph.correct.shapes.formula import Formula
from bondgraph.correct.shapes.library import products
from bondgraph.correct.shapes.subsets import (
    MOST_TERMS,
    Sum,
    Terms,
    best_sums,
    elsewhere,
    lost,
    scored_products,
    scored_terms,
    tried,
)
from bondgraph.declare.effect import Place
from bondgraph.estimate.local import Report

#: Places at which functions are tried while a law of the dictionary passes, and where none does; signals of a formula.
_PLACES, _ALL_PLACES, _SIGNALS = 3, 8, 4
#: Scores are right to a factor of two: a function that promises less than this share of a law's gain is behind it.
_WORTH = 0.4
#: Places whose best function gains at least this share of the best of all get formulas, at most so many.
_NEAR, _MOST_PLACES = 0.8, 2
#: Formulas of one term that are refitted at each place, of those that promise about as much as the best, and of each
#: number of terms beyond.
_ALONE, _SUMS = 2, 1
#: The form of a law may leave so large a share of what the law gained: of relatives as much is left. A convention.
_OF_FORM = 0.1
#: A law that is smaller than this nearly everywhere has no size: one over it can be told in numbers.
_SMALLEST = math.sqrt(float(np.finfo(float).tiny))


@dataclass(frozen=True)
class Residual:
    """Rest that a fitted model leaves, and where it may come from; ``laws`` are those that were added to it before."""

    built: BuiltModel
    linear: Linearisation
    probed: Sequence[Probe]
    signals: Sequence[Signal]
    located: Sequence[LocatedAt]
    laws: Sequence[Trial] = ()

    def is_of_a_form(self, gain: float) -> bool:
        """True for so small a gain, in nats, that it may be what the form of a law leaves, wherever that shows."""
        return gain < _OF_FORM * max((one.gain for one in self.laws), default=0.0)


@dataclass(frozen=True)
class Option:
    """A sum of terms worth a refit: the library it is of, its place, and others at which it shows in the same way.

    ``beside``: it is refitted beside another one that promises a little more, since its signal is that of the place.
    """

    terms: Terms
    chosen: Sum
    probe: Probe
    twins: tuple[Place, ...] = ()
    beside: bool = False


def with_formulas(
    trials: Sequence[Trial], scored: Scored, left: Residual, context: Context, report: Report
) -> list[Trial]:
    """The trials, and the formulas that were refitted.

    Parameters
    ----------
    trials
        Laws of the dictionary with their scores, the best refitted.
    scored
        Scores of the laws that can be scored, with their responses.
    left
        The residual of the fit without them.
    context
        What refits start from.
    report
        Told of each refit.
    """
    law = choose(trials, context.level)
    if law is not None and context.base.problem.filter_model.is_stiff:
        return list(trials)  # a refit costs a compilation and minutes; what the law leaves is looked at in the end
    known, least = distinct(left.signals), _WORTH * _promised(scored, law)
    where = _suspects(left, _ALL_PLACES if law is None else _PLACES)
    functions = splines(left.linear, where, known)
    measured = sum(int(np.isfinite(log.y).sum()) for log in context.train)
    found = unexplained(functions, measured, context.level)
    plain = found is not None and found.signal != "time" and found.gain >= least
    options, counts = _options(functions if plain else (), known, left, measured, 1 if law else MOST_TERMS)
    crossed, pairs = _crossed(where, functions, known, left, measured, least)
    counts = {**counts, 1: counts[1] + pairs}
    options = sorted([*crossed, *options], key=lambda one: (not one.beside, -one.chosen.worth))
    foremost = next((one for one in options if not one.beside), None)
    if law is not None and foremost is not None and _says(law, foremost, scored, left):
        return list(trials)
    done, refitted = list(trials), {one.candidate.label for one in trials}
    for k, option in enumerate(options):
        report("refit formulas", k, len(options))
        if f"{formula_at(option.probe, option.chosen, left.signals).name} at {option.probe.place.label}" in refitted:
            continue  # as a form of a law that was found before
        made = _refitted(option, left, context, context.tried + counts[len(option.chosen.terms)])
        done, refitted = done + made, refitted | {one.candidate.label for one in made}
        if law is not None and made and not option.beside and not made[0].gain > law.gain + INDIFFERENT:
            break  # the foremost does not beat the law
    report("refit formulas", len(options), len(options))
    return done


def _promised(scored: Scored, law: Trial | None) -> float:
    """What the score of the law that passes promises, nats: right to a factor of two, as that of a function is."""
    labels = [one.label for one in scored.candidates]
    if law is None or law.candidate.label not in labels:
        return 0.0
    return float(scored.scores.gain[labels.index(law.candidate.label)])


def _options(
    functions: Sequence[Spline], known: Sequence[Signal], left: Residual, measured: int, most: int
) -> tuple[list[Option], dict[int, int]]:
    """Sums of terms worth a refit, of all places, the most promising first, and what counts as tried by their length.

    Every length has an equal share in the chance of a false alarm, so that short sums are not judged by how many long
    ones there are.

    Each is worth more than the free function, by the Bayesian information criterion: what leaves a part of that is no
    law of the shape.
    """
    found: list[Option] = []
    counts = dict.fromkeys(range(1, most + 1), 0)
    for one in _places(functions):
        signals = [_signal(known, name) for name in _arguments(functions, one)]
        terms = scored_terms(left.linear, one.probe, known, signals)
        counts = {size: before + most * tried(terms, size) for size, before in counts.items()}
        sums = _sums(terms, one, measured, most)
        found += [_at_home(terms, chosen, left) for chosen in sums]
        found += [Option(terms, own, one.probe, beside=True) for own in _own(terms, sums, left, one, measured)]
    return sorted(found, key=lambda option: -option.chosen.worth), counts


def _crossed(
    where: Sequence[Probe],
    functions: Sequence[Spline],
    known: Sequence[Signal],
    left: Residual,
    measured: int,
    least: float,
) -> tuple[list[Option], int]:
    """Products of two signals that promise more than every function of one at their place, and how many were tried.

    A product may be no function of either signal: a speed that couples two windings takes current from both. A plain
    one may promise a little less, since scores are rough; a form of a second signal fits much, and must promise
    clearly more.
    """
    found: list[Option] = []
    count = 0
    for probe in where if products(known) else ():
        terms = scored_products(left.linear, probe, known)
        count += tried(terms, 1)
        most = max([least, *(one.gain for one in functions if one.probe is probe)])
        ranked = best_sums(terms, measured, 1, len(terms.terms))
        bent, plain = most + INDIFFERENT, _NEAR * most
        better = [one for one in ranked if one.gain > (bent if one.terms[0].kind.bends else plain)]
        found += [_at_home(terms, one, left) for one in _worthwhile(better) if one.worth > 0.0]
    kept = [one for one in found if not (one.chosen.terms[0].kind.bends and left.is_of_a_form(one.chosen.gain))]
    return sorted(kept, key=lambda option: -option.chosen.gain)[: _ALONE * _MOST_PLACES], count


def _sums(terms: Terms, free: Spline, measured: int, most: int) -> list[Sum]:
    """Sums worth a refit, which are worth more than a free function of the signal."""
    sums = best_sums(terms, measured, most, _ALONE)
    return _worthwhile([chosen for chosen in sums if chosen.worth > _worth(free, measured)])


def _worth(free: Spline, measured: int) -> float:
    """The gain of a free function less half a logarithm of the measurements for every knot."""
    return free.gain - 0.5 * free.knots.size * math.log(max(measured, 2))


def _own(terms: Terms, sums: Sequence[Sum], left: Residual, free: Spline, measured: int) -> list[Sum]:
    """The best term in a signal of the place itself, if it promises about as much as the best sum, which has another.

    Scores are rough. A collector lost heat above a temperature of its own; one of its store promised 2 nats of 75 more,
    and gained 17 less.
    """
    best = max((one.gain for one in sums), default=math.inf)
    every = best_sums(terms, measured, 1, len(terms.terms))
    near = [one for one in every if one.gain > _NEAR * best and one.worth > _worth(free, measured)]
    own = [one for one in near if _belongs(one.terms[0].signals[0], terms.probe.place, left.built)]
    return [one for one in own[:1] if all(one.terms != other.terms for other in sums)]


def _at_home(terms: Terms, chosen: Sum, left: Residual) -> Option:
    """The sum at the place that its signals belong to, if it shows there as where it was found, and its other places.

    A current that a node loses by its own voltage shows as a drop of the line before it by the voltage of the node. A
    law of what is its own at a place is simpler than one of what happens elsewhere.
    """
    same = {terms.probe.place.label: (terms.probe, chosen)}
    for probe in left.probed:
        if probe.variable != "sensor" and probe is not terms.probe:
            there = elsewhere(left.linear, chosen, terms.probe, probe, left.signals)
            if there is not None:
                same[probe.place.label] = (probe, there)
    signals = {name for term in chosen.terms for name in term.signals}
    best = max(same, key=lambda label: sum(_belongs(name, same[label][0].place, left.built) for name in signals))
    twins = tuple(probe.place for label, (probe, _) in same.items() if label != best)
    return Option(terms, same[best][1], same[best][0], twins)


def _belongs(name: str, place: Place, built: BuiltModel) -> bool:
    """True for a signal that is a variable of a place, or of an element there."""
    variable, _, of = name.partition(" of ")
    if variable in ("effort", "flow"):
        return of == place.label and (variable == "flow") == (place.junction.kind == "1")
    return {place.junction.name, of} in ({bond.source, bond.target} for bond in built.causal.graph.bonds)


def own_forms(laws: Sequence[Trial], scored: Scored, left: Residual, context: Context, report: Report) -> list[Trial]:
    """Formulas by which laws that were found before take a form of their own, refitted.

    They come before all other candidates: what acts at another place must explain more than such a form does, and what
    acts at its place is one anyway. None where the best law promises more than twice as much, and of stiff models.
    """
    done: list[Trial] = []
    measured = sum(int(np.isfinite(log.y).sum()) for log in context.train)
    promised = float(np.max(scored.scores.gain, initial=0.0))
    for first in [] if context.base.problem.filter_model.is_stiff else laws:
        free = _free_form(first, left)
        if free is None or free.gain < max(_WORTH * promised, context.required):
            continue
        terms = scored_terms(left.linear, free.probe, [free.signal], [free.signal])
        sums = _sums(terms, free, measured, MOST_TERMS)
        for k, chosen in enumerate(sums):
            report(f"refit forms of {first.candidate.label}", k, len(sums))
            count = context.tried + MOST_TERMS * tried(terms, len(chosen.terms))
            made = _refitted(Option(terms, chosen, free.probe), left, context, count)
            done += [replace(one, completes=first.candidate.label) for one in made]
    return done


def best_term(place: Place, signal: Signal, left: Residual, context: Context) -> Trial | None:
    """The one term of the library in a signal that does most at a place beside a fitted model, refitted; None if none.

    ``left`` is the residual of that model, ``context`` has it as its base.
    """
    probe = next((one for one in left.probed if one.place.label == place.label), None)
    if probe is None:
        return None
    terms = scored_terms(left.linear, probe, [signal], [signal])
    sums = best_sums(terms, sum(int(np.isfinite(log.y).sum()) for log in context.train), 1, _ALONE)
    made = [_refitted(Option(terms, chosen, probe), left, context, context.tried) for chosen in sums]
    return max((one for each in made for one in each if one.evidence), key=lambda one: one.gain, default=None)


def _free_form(first: Trial, left: Residual) -> Spline | None:
    """Free function of the only signal of a law that is left at its place; None of a law that stores."""
    names, element = arguments(first, left.built.graph), first.candidate.effect.element
    node, kind = left.built.causal.graph.nodes.get(element), first.candidate.place.junction.kind
    if names is None or len(names) != 1 or (node is not None and (node.kind, kind) in (("I", "1"), ("C", "0"))):
        return None
    signal = next((one for one in left.signals if {one.name} == names), None)
    probe = next((one for one in left.probed if one.place.label == first.candidate.place.label), None)
    return None if signal is None or probe is None else next(iter(splines(left.linear, [probe], [signal])), None)


def _says(law: Trial, option: Option, scored: Scored, left: Residual) -> bool:
    """True for a term that a law of the dictionary says in other words: the law would lose next to nothing to it."""
    labels = [one.label for one in scored.candidates]
    if law.candidate.label not in labels:
        return False
    own = scored.columns[labels.index(law.candidate.label)]
    shown = option.terms.responses(left.linear, option.chosen, left.signals)
    return lost(left.linear, shown, own) * option.chosen.gain < INDIFFERENT


def _suspects(left: Residual, most: int) -> list[Probe]:
    """Probes of the junctions that explain most of the residual; a sensor's error is no law of the machine."""
    order = [place.junction for place in left.located]
    junctions = [probe for probe in left.probed if probe.variable != "sensor"]
    return sorted(junctions, key=lambda probe: order.index(probe.place.label))[:most]


def _places(functions: Sequence[Spline]) -> list[Spline]:
    """The best function at each place that explains about as much as the best; of rigidly tied places one."""
    best: dict[str, Spline] = {}
    for one in sorted(functions, key=lambda one: -one.gain):
        if one.signal.name != "time":
            best.setdefault(one.probe.place.label, one)
    ranked = list(best.values())
    kept: list[Spline] = []
    for one in ranked:
        twin = any(one.signal.name == other.signal.name and other.gain - one.gain < INDIFFERENT for other in kept)
        if one.gain >= _NEAR * ranked[0].gain and not twin:
            kept.append(one)
    return kept[:_MOST_PLACES]


def _arguments(functions: Sequence[Spline], best: Spline) -> list[str]:
    """Names of the signals of which functions explain most at a place."""
    own = [one for one in functions if one.probe is best.probe and one.signal.name != "time"]
    return [one.signal.name for one in sorted(own, key=lambda one: -one.gain)][:_SIGNALS]


def _signal(known: Sequence[Signal], name: str) -> Signal:
    return next(one for one in known if one.name == name)


def _worthwhile(sums: Sequence[Sum]) -> list[Sum]:
    """Sums of one term that promise about as much as the best, and longer ones that promise clearly more."""
    alone = [one for one in sums if len(one.terms) == 1]
    best = max((one.gain for one in alone), default=0.0)
    kept = [one for one in alone if one.gain >= _NEAR * best][:_ALONE]
    worth = max((one.worth for one in alone), default=0.0)
    for size in range(2, MOST_TERMS + 1):
        longer = [one for one in sums if len(one.terms) == size and one.worth > worth + INDIFFERENT][:_SUMS]
        kept += longer
        worth = max([worth, *(one.worth for one in longer)])
    return kept


def _refitted(option: Option, left: Residual, context: Context, count: int) -> list[Trial]:
    """The trial of a sum of terms as a formula, refitted; none where the graph has no room for it."""
    found = option.chosen
    formula = formula_at(option.probe, found, left.signals)
    made, _ = candidates(left.built, [formula.effect()], [option.probe.place])
    if not made:
        return []
    twins = tuple(f"{formula.name} at {place.label}" for place in option.twins)
    trial = Trial(made[0], found.gain, tuple(map(float, found.step)), stands_for=twins)
    start = [float(value) for value in found.step]
    return [trial.attempted(lambda: refit_from(trial, start, context, tried=count))]


def formula_at(probe: Probe, found: Sum, known: Sequence[Signal]) -> Formula:
    """The formula of a sum of terms at the place of a probe."""
    domain = probe.place.domain
    unit = "" if domain is None else domain.effort_unit if probe.variable == "effort" else domain.flow_unit
    courses = [
        np.concatenate([term.courses(known, log) for log in range(len(probe.changes))], axis=1) for term in found.terms
    ]
    sizes = [max(float(np.percentile(np.abs(law), 99.0)), _SMALLEST) for laws in courses for law in laws]
    return Formula(probe.place, probe.variable, unit, found.terms, tuple(sizes))
