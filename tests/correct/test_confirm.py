"""A second look at what passed: the fit without it from where the refit ended, and searches that are not finished."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.correct.evidence import confirm
from bondgraph.correct.evidence.confirm import confirmed
from bondgraph.correct.search.refit import refit_from
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from tests.correct.test_stiff import rivals
from tests.correct.winch import drawn, fitted, setup_of


def worse(best: Fit, by: float) -> Fit:
    """The fit as a search would have left it that ended elsewhere, the drag off by so much of its bounds."""
    point, drag = best.point.copy(), best.problem.names.index("c")
    point[drag] += by * (best.problem.upper - best.problem.lower)[drag]
    return replace(best, point=point, nll=float(best.problem.nll(point[:, np.newaxis])[0]))


@pytest.mark.parametrize("samples", [None, 200])
def test_a_fit_without_the_law_that_ended_too_early_is_found_from_where_the_refit_ended(
    monkeypatch: pytest.MonkeyPatch, samples: int | None
) -> None:
    """On the whole log, and by way of its beginning; what is gained over the better fit is what counts."""
    trials, _, context = rivals()
    drag = refit_from(trials[0], trials[0].step, context)
    assert drag.fit is not None and drag.evidence is not None
    monkeypatch.setattr(confirm, "is_clear", lambda *given: False)
    monkeypatch.setattr(confirm, "_in_free_simulation", lambda refit, trial, evidence, context: evidence)
    monkeypatch.setattr(confirm, "excerpt", lambda problem: None if samples is None else excerpt(problem, samples))
    early = worse(context.base, 0.1)
    assert early.nll > context.base.nll + 10.0
    fair = drag.fit.nll - context.base.nll
    looked = confirmed(drag, replace(context, base=early))
    assert looked.evidence is not None
    assert looked.evidence.delta_nll == pytest.approx(-fair, abs=1.0)


def test_what_does_not_beat_what_is_known_by_enough_is_not_finished() -> None:
    """A negative reach: only what is already ahead by so much is worth exact derivatives."""
    log, best = drawn(0.0), fitted(0.0)
    setup = setup_of(log)
    free = (*free_parameters(setup, ()), *setup.noise)
    finished, left = (
        fit(
            EstimationProblem(setup.filter_model, (log,), tuple(free)),
            starts=(worse(best, 0.3).point,),
            beat=best.nll,
            reach=reach,
        )
        for reach in (60.0, -1e6)
    )
    # where a search without exact derivatives ends is a matter of rounding: too far behind, nothing is finished
    assert finished.nll <= left.nll and finished.evaluations >= left.evaluations
    assert finished.evaluations > left.evaluations or left.nll > best.nll + 10.0
