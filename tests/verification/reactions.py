"""Published stiff problems of chemistry."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from sympy import exp

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from tests.verification.claims import Answer, Claim, Published, within
from tests.verification.filters import FORMS
from tests.verification.machines import rates_graph


@cache
def robertson() -> Model:
    """Three species, rates that differ by nine orders of magnitude (Robertson 1966)."""

    def rates(a: Any, b: Any, c: Any) -> tuple[Any, ...]:
        slow, fast, middle = 0.04 * a, 3e7 * b**2, 1e4 * b * c
        return middle - slow, slow - middle - fast, fast

    return build(rates_graph("robertson", {"a": 1.0, "b": 0.0, "c": 0.0}, {}, rates, lambda a, b, c: (a, b, c))).model


#: Times that grow by a fifth: fixed steps within them follow the fast start as well as the slow end.
_GEOMETRIC = np.concatenate([[0.0], 40.0 * 1.2 ** np.arange(-100.0, 1.0)])


def species(case: Published) -> Answer:
    end = case["inputs"]["t"]
    time = _GEOMETRIC * end / _GEOMETRIC[-1]
    runs = [simulate(robertson(), time, method=name, rtol=1e-10) for name in ("adaptive", "Radau", "BDF")]
    runs += [simulate(robertson(), time, method="rodas4", substeps=20, compiled=compiled) for compiled in FORMS]
    return Answer(case["expected"]["y"], [run.x[:, -1] for run in runs])


#: Volumes of the cytoplasm and the nucleus, pl, and the whole STAT5, nM.
_CYTOPLASM, _NUCLEUS, _TOTAL = 1.4, 0.45, 207.6


def phosphorylation(
    Epo: Any, khet: Any, khomo: Any, imhet: Any, imhomo: Any, kphos: Any, spec: Any,
    A: Any, B: Any, pAB: Any, pAA: Any, pBB: Any, nAA: Any, nAB: Any, nBB: Any, clock: Any,
) -> tuple[Any, ...]:  # fmt: skip
    """Rates of Boehm et al. (2014): STAT5A and B, their phosphorylated pairs, and these in the nucleus; time in min."""
    hormone = 1.25e-7 * exp(-Epo * clock)
    pairs = [kphos * hormone * pair for pair in (A * A, A * B, B * B)]
    into = [imhomo * pAA, imhet * pAB, imhomo * pBB]
    out = [khomo * nAA, khet * nAB, khomo * nBB]
    back, ahead = _NUCLEUS / _CYTOPLASM, _CYTOPLASM / _NUCLEUS
    return (
        back * (2 * out[0] + out[1]) - 2 * pairs[0] - pairs[1],
        back * (2 * out[2] + out[1]) - 2 * pairs[2] - pairs[1],
        pairs[1] - into[1],
        pairs[0] - into[0],
        pairs[2] - into[2],
        ahead * into[0] - out[0],
        ahead * into[1] - out[1],
        ahead * into[2] - out[2],
        1,
    )


def measured(spec: Any, A: Any, B: Any, pAB: Any, pAA: Any, pBB: Any, **rest: Any) -> tuple[Any, ...]:
    """Shares of phosphorylated STAT5A and B, and of STAT5A in both, in percent."""
    of_a, of_b = spec * (A + 2 * pAA), (1 - spec) * (B + 2 * pBB)
    return (
        100 * (pAB + 2 * spec * pAA) / (pAB + of_a),
        100 * (pAB + 2 * (1 - spec) * pBB) / (pAB + of_b),
        100 * (pAB + of_a) / (2 * pAB + of_a + of_b),
    )


@cache
def boehm(values: tuple[tuple[str, float], ...]) -> Model:
    nominal = dict(values)
    share = nominal.pop("ratio")
    states = {"A": _TOTAL * share, "B": _TOTAL * (1.0 - share)}
    states |= dict.fromkeys(("pAB", "pAA", "pBB", "nAA", "nAB", "nBB", "clock"), 0.0)
    return build(rates_graph("boehm", states, nominal, phosphorylation, measured)).model


def boehm_nll(case: Published) -> Answer:
    nominal, table = dict(case["inputs"]["nominal"]), case.table()
    noise = nominal.pop("sd")
    model = boehm(tuple(nominal.items()))
    rows = [table[table["observable_index"] == k] for k in range(3)]
    log = MatchedLog("boehm", rows[0]["time"], np.zeros((0, rows[0].size)), np.array([row["value"] for row in rows]))
    outputs = {f"y{k + 1}": std for k, std in enumerate(noise)}
    exact = FilterModel(model, {}, outputs, {}, substeps=20, method="rodas4")
    got = [likelihood(exact, log, compiled=compiled).nll[0] for compiled in FORMS]
    return Answer(case["expected"]["nllh_at_nominal"], got)


CLAIMS = (
    Claim("robertson_t40", "species", (simulate,), species, within("rel", "relative"), ("y",)),
    Claim(
        "petab_boehm_nllh", "nll at the nominal parameters", (likelihood,), boehm_nll, within("abs"),
        ("nllh_at_nominal",),
    ),
)  # fmt: skip
