"""All claims, in the order of the table."""

from __future__ import annotations

from tests.verification import filters, identifiability, likelihoods, optima, reactions, regressions

CLAIMS = (
    *filters.CLAIMS,
    *likelihoods.CLAIMS,
    *regressions.CLAIMS,
    *reactions.CLAIMS,
    *identifiability.CLAIMS,
    *optima.CLAIMS,
)
