"""How a computation ended, as a value: a diverging member of a swarm must not stop the others."""

from __future__ import annotations

import enum


class Outcome(enum.Enum):
    """End of an integration or a filter run; the value is the message.

    Examples
    --------
    >>> Outcome.OK.value
    'finished'
    >>> describe_end(Outcome.DIVERGED, 1.25).split(" - ")[0]
    'the state grew without bound or became non-finite, at t = 1.25 s'
    """

    OK = "finished"
    DIVERGED = (
        "the state grew without bound or became non-finite"
        " - use more substeps or a stiff method, or parameters nearer to their nominal values"
    )
    NON_FINITE = (
        "the model's equations gave a value that is not a finite number"
        " - check parameters, inputs and initial state there"
    )
    STEP_LIMIT = (
        "the integrator used all the steps it may take"
        " - raise max_steps, loosen rtol, or use a stiff method (Radau, BDF)"
    )
    ZENO = (
        "events follow each other ever faster (a Zeno point)"
        " - declare the contact as an impact, which comes to rest, or derive the graph smooth"
    )
    CHATTER = (
        "a switch changes its side again and again at one instant, since both sides lead back to it (a sliding mode)"
        " - declare it as a friction, which can lock, give it a hysteresis, or derive the graph smooth"
    )
    NO_MODE = (
        "no combination of locked and slipping elements fits the equations"
        " - check that static capacities are not below sliding ones, or derive the graph smooth"
    )
    NOT_POSITIVE = (
        "the innovation covariance lost positive definiteness"
        " - use beta >= alpha^2, larger measurement noise, or smaller initial uncertainty"
    )
    ILL_CONDITIONED = (
        "the likelihood is ill-conditioned: rounding moves it, since integration steps multiply small differences"
        " - use more substeps, or method 'auto', which plans them"
    )
    ABANDONED = "given up, since its negative log-likelihood could no longer come below its ceiling - set none to go on"


#: Codes of the compiled kernels and of those who call them, in this order.
OUTCOMES = (Outcome.OK, Outcome.DIVERGED, Outcome.NOT_POSITIVE, Outcome.ABANDONED, Outcome.ILL_CONDITIONED)


def describe_end(outcome: Outcome, ended_at: float) -> str:
    """The message of an outcome with the time at which it happened."""
    message = str(outcome.value)
    if outcome is Outcome.OK:
        return message
    what, _, advice = message.partition(" - ")
    return f"{what}, at t = {ended_at:.6g} s - {advice}"
