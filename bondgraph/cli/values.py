"""Words of a command line as values."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bondgraph.declare.editing import with_values
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import OptionError


def names(groups: Sequence[str]) -> list[str]:
    """Names given as ``a,b`` or as several words."""
    return [name.strip() for group in groups for name in _split(group) if name.strip()]


def _split(group: str) -> list[str]:
    """Split at commas that stand outside parentheses, since ``x0(v, run)`` is one name."""
    parts, depth = [""], 0
    for letter in group:
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def assignments(pairs: Sequence[str], option: str) -> dict[str, float | str]:
    """Values from ``name=value`` pairs; what is no number stays text (the letter of a gear)."""
    found: dict[str, float | str] = {}
    for pair in pairs:
        name, equals, text = (part.strip() for part in pair.partition("="))
        if not equals or not name or not text:
            raise OptionError(f"{option} {pair}: write it as name=value, such as J=0.05", where=(option, pair))
        try:
            value = float(text)
        except ValueError:
            found[name] = text
            continue
        if not math.isfinite(value):
            raise OptionError(f"{option} {pair}: the value must be a finite number", where=(option, name))
        found[name] = value
    return found


def set_values(graph: BondGraph, pairs: Sequence[str]) -> tuple[BondGraph, dict[str, float | str]]:
    """A graph with the values of ``--set`` for its parameters, and those for its inputs.

    Raises
    ------
    OptionError
        If a parameter is given a text.
    DeclarationError
        If there is no such parameter.
    """
    given = assignments(pairs, "--set")
    inputs = {one.name for one in graph.flatten().inputs}
    values = {name: value for name, value in given.items() if name not in inputs and isinstance(value, float)}
    for name, value in given.items():
        if name not in inputs and name not in values:
            raise OptionError(
                f"--set {name}={value}: --set gives numbers to the parameters of a declared graph, and numbers or "
                "letters to its inputs",
                where=("--set", name),
            )
    declared = {one.name: one for one in graph.flatten().parameters}
    own = {name: declared[name].coherent(v) if name in declared else v for name, v in values.items()}
    changed = with_values(graph, own) if own else graph
    return changed, {name: value for name, value in given.items() if name in inputs}


def initial(given: Sequence[str]) -> dict[str, float]:
    """Initial states from ``state=value`` pairs or JSON files."""
    found: dict[str, float] = {}
    for item in given:
        values = read_json(item, "--initial") if item.endswith(".json") else assignments([item], "--initial")
        for name, value in values.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise OptionError(f"--initial {name}={value}: the value must be a number", where=("--initial", name))
            found[name] = float(value)
    return found


def read_json(path: str, option: str) -> Any:
    """The value of a JSON file given to an option."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise OptionError(f"{option} {path}: no such file", where=(option, path)) from None
    except OSError as error:
        raise OptionError(f"{option} {path}: cannot be read ({error.strerror})", where=(option, path)) from None
    except (ValueError, RecursionError) as error:
        raise OptionError(f"{option} {path}: not JSON ({error})", where=(option, path)) from None
