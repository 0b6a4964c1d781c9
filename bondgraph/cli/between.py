"""Inputs that run between samples as ``--inputs-between`` says."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

from bondgraph.declare.editing import with_inputs_between
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Interpolation
from bondgraph.errors import OptionError

#: How inputs run between samples, by the words of ``--inputs-between``.
WAYS: Mapping[str, Interpolation] = {"held": "hold", "linear": "linear", "band": "band limited"}


def inputs_between(graph: BondGraph, options: argparse.Namespace) -> BondGraph:
    """The graph with its inputs running between samples as ``--inputs-between`` says.

    Raises
    ------
    OptionError
        If there is no such way or input, or the input is a code.

    Examples
    --------
    >>> g = BondGraph("shaker")
    >>> _ = g.input("force", "N"), g.input("switch", "1", hold=True)
    >>> asked = argparse.Namespace(inputs_between=["band"])
    >>> [one.interpolation for one in inputs_between(g, asked).inputs]
    ['band limited', 'hold']
    """
    running = [one.name for one in graph.flatten().inputs if not one.is_held]
    ways = ways_between(running, options)
    return with_inputs_between(graph, **ways) if ways else graph


def ways_between(running: Sequence[str], options: argparse.Namespace) -> dict[str, Interpolation]:
    """How inputs run between samples, by their names; ``running`` are those that are meant where none is named.

    Raises
    ------
    OptionError
        If there is no such way.
    """
    ways: dict[str, Interpolation] = {}
    for option in options.inputs_between:
        name, equals, word = (part.strip() for part in option.rpartition("="))
        if word not in WAYS or bool(name) != bool(equals):
            raise OptionError(
                f"--inputs-between {option}: write {', '.join(WAYS)}, or input=way such as force=band",
                where=("--inputs-between", option),
            )
        ways |= dict.fromkeys([name] if name else running, WAYS[word])
    return ways
