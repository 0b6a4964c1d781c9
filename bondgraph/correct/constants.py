"""The numbers that decide what a closed loop says, each with its meaning and where it comes from.

Numbers of methods (tolerances of a search, grids of starts, what rounding leaves) stand with their method: other values
of these change how long a loop takes, not what it may claim.
"""

from __future__ import annotations

from collections.abc import Mapping

from bondgraph.estimate.otherwise import INDIFFERENT as INDIFFERENT
from bondgraph.estimate.otherwise import SMOOTH_OPTIMISM

#: Chance of a false alarm over all candidates of the first round, corrected for their number (Bonferroni). Rounds
#: beside laws have less, see ``RoundSettings.beside``.
LEVEL = 0.01
#: Parts of a sensor's noise by which a law must move it to be named: alone, and beside a larger law, whose form leaves
#: something too. A sensor is hardly better than a fifth of its noise over its range, and a third is the smallest error
#: of a model at which the studies count what is found: conventions.
FAINT, NOTICED = 0.2, 1.0 / 3.0
#: Share by which a given constant may be off, two standard deviations of it: the tolerance with the letter K, of common
#: electronic components (IEC 60062). Masses and lengths are known better, friction worse: a convention.
TOLERANCE = 0.1
#: Share of what something else explains from which a law counts as an answer to it: most of it, a convention.
MOSTLY = 0.5
#: Chance of what is looked at as that of a single test: a score, a gain of folds that were left out.
CHANCE = 0.05
#: Effects that are added at most, and candidates of one round that are refitted at most; what is left out is named.
MOST_EFFECTS, MOST_REFITS = 3, 12
#: Measurements per free parameter below which nothing can be concluded: the rule of ten events per variable, twice.
#: Harrell (2015), Regression Modeling Strategies, section 4.4.
MEASUREMENTS_EACH = 20
#: Blocks of time whose scatter gives variances that coloured noise does not deceive: enough for the distribution of a
#: variance, long enough to be independent. On how many are few: Carter, Schnepel and Steigerwald (2017), Review of
#: Economics and Statistics 99(4).
BLOCKS = 40
#: Stretches of training and held-out data over which errors of predictions are compared.
WINDOWS = 20
#: Folds of the training data: each log where there are as many as the second number, else as many blocks of time as the
#: first. Arlot and Celisse (2010), Statistics Surveys 4, find little gain beyond five to ten.
FOLDS, LOGS_AS_FOLDS = 6, 3
#: Largest correlation from sample to sample that is allowed for: beyond it hardly a block of time is independent.
LONGEST_MEMORY = 0.97
#: Information of a coefficient left beside free parameters, as a share of all of it, below which these take what it
#: explains: of exact twins, a mass beside a free mass, up to 0.3 % are left by integration steps and rounding.
FREE_TAKE = 1e-2
#: Standard errors from which a change of held-out likelihood confirms a correction or contradicts it: 95 of 100.
CONFIRMS = 2.0
#: Chance of being found at the size that is called detectable.
POWER = 0.9
#: Gains of fits over predicted ones, before a search has shown them, by class: scores of smooth laws are
#: right to a factor of two or three, those of dry friction on a vehicle were too small sevenfold.
OPTIMISM: Mapping[str, float] = {
    "smooth": SMOOTH_OPTIMISM, "switching": 7.0, "storage": 2.5, "event": 2.5, "regime": 2.5,
}  # fmt: skip
#: The quantile of what a search has shown of these ratios that its bounds count with.
UPPER = 0.9
