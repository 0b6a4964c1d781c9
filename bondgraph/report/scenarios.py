"""Scenarios, panels and noises declared beside a graph, found by the reference of the graph."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bondgraph.declare.loading import is_code_reference, load_module
from bondgraph.errors import OptionError, suggest
from bondgraph.filter.noise import Noise
from bondgraph.simulate.scenario import Panel, Scenario


def declared_scenario(reference: str, name: str) -> Scenario:
    """The scenario of that name in the module of a graph.

    Raises
    ------
    OptionError
        If there is none; the message lists those that exist.

    Examples
    --------
    >>> declared_scenario("motor.json", "start")
    Traceback (most recent call last):
    ...
    bondgraph.errors.OptionError: --scenario start: motor.json declares no scenarios - give its inputs by
    --inputs FILE.csv, or declare SCENARIOS in the module of the graph
    """
    known: Mapping[str, Scenario] = _declared(reference, "SCENARIOS", {})
    if not known:
        raise OptionError(
            f"--scenario {name}: {reference} declares no scenarios - give its inputs by --inputs FILE.csv, or declare "
            "SCENARIOS in the module of the graph",
            where=("--scenario", name),
        )
    if name not in known:
        listed = "".join(f"\n  {one}: {scenario.meaning}" for one, scenario in known.items())
        raise OptionError(
            f"--scenario {name}: {reference} has no scenario of this name{suggest(name, known)} - it has{listed}",
            where=("--scenario", name),
        )
    return known[name]


def declared_panels(reference: str) -> Sequence[Panel]:
    """The panels in the module of a graph, none where it declares none."""
    panels: Sequence[Panel] = _declared(reference, "PANELS", ())
    return panels


def declared_noise(reference: str, model: str) -> Noise | None:
    """The noise that the module of a graph declares for a model, None where it declares none."""
    known: Mapping[str, Noise] = _declared(reference, "NOISE", {})
    return known.get(model)


def _declared(reference: str, name: str, otherwise: Any) -> Any:
    return getattr(load_module(reference), name, otherwise) if is_code_reference(reference) else otherwise
