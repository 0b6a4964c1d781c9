"""Pages made from the toolkit itself: dictionary of effects, commands, names of each room, schema of graph files."""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from bondgraph.declare.schema import graph_schema
from bondgraph.effects.catalogue import Entry, catalogue, modules
from bondgraph.effects.curves import curve_of
from bondgraph.files import write_text
from bondgraph.report.dictionary import law_figure, table_json
from bondgraph.report.figures import save_figure

#: Rooms whose exported names are documented, in the order of a model's way.
ROOMS = ("declare", "derive", "generate", "data", "simulate", "filter", "estimate", "correct", "report", "exchange")


def write_reference(folder: Path, commands: argparse.ArgumentParser) -> None:
    """Write all pages that are made from the toolkit, and the pictures of laws, into a folder.

    Parameters
    ----------
    folder
        Of the staged site; ``reference``, ``effects`` and ``files`` are made in it.
    commands
        The parser of the command line.
    """
    for name in ("reference", "effects", "files"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    write_text(folder / "files" / "bondgraph-1.schema.json", json.dumps(graph_schema(), indent=1))
    write_text(folder / "files" / "effects.json", json.dumps(table_json(catalogue()), indent=1))
    write_text(folder / "reference" / "commands.md", commands_page(commands))
    for room in ROOMS:
        write_text(folder / "reference" / f"{room}.md", room_page(room))
    write_effects(folder / "effects")


# ---------------------------------------------------------------------- effects


def write_effects(folder: Path) -> None:
    """Write a page for each module of the dictionary, with a picture of each law that is a curve."""
    for module in modules():
        rows = [row for row in catalogue() if row.module == module.__name__]
        pictures = [row.name for row in rows if _draw(row, folder)]
        name = module.__name__.rpartition(".")[2]
        title = f"# {name.capitalize()}\n\n{(inspect.getdoc(module) or '').partition(chr(10))[0]}\n"
        write_text(folder / f"{name}.md", "\n".join([title, *(effect_text(row, row.name in pictures) for row in rows)]))


def effect_text(row: Entry, picture: bool) -> str:
    """The section of one effect.

    Examples
    --------
    >>> from bondgraph.effects.catalogue import named
    >>> effect_text(named("orifice_loss")[0], picture=False).splitlines()[0]
    '## `orifice_loss`'
    """
    kinds = [
        f"| `{one.name}` | {'shape' if one.shape else 'coefficient'} | {_unit(one.unit)} | {_plain(one.meaning)} |"
        for one in row.coefficients
    ]
    facts = [
        ("Law", f"`{row.law}`"),
        ("Domain", ", ".join(row.domains)),
        ("Place", row.place),
        ("Shown by", _plain(row.manoeuvre)),
        ("Reference", _plain(row.reference)),
        ("Function", f"`{row.module}:{row.function}`" + ("" if row.default else ", tried where `--effects` names it")),
    ]
    lines = [f"## `{row.name}`", "", _plain(row.meaning.partition("\n\n")[0]), ""]
    if picture:
        lines += [f"![{row.name}: {row.law}]({row.name}.svg)", ""]
    lines += ["| | |", "|---|---|", *(f"| {name} | {_cell(text)} |" for name, text in facts if text), ""]
    if kinds:
        lines += ["| parameter | | unit | meaning |", "|---|---|---|---|", *kinds, ""]
    if row.dissipative:
        lines += ["It only takes energy: a negative coefficient is refused.", ""]
    return "\n".join(lines)


def _draw(row: Entry, folder: Path) -> bool:
    curve = curve_of(row)
    if curve is not None:
        save_figure(law_figure(row, curve), folder / f"{row.name}.svg")
    return curve is not None


def _unit(unit: str) -> str:
    return "by domain" if unit == "by domain" else f"`{unit or '1'}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _plain(text: str) -> str:
    """A docstring or sentence as Markdown, on one line."""
    return _cell(" ".join(text.replace("``", "`").split()))


# ---------------------------------------------------------------------- commands and names


def commands_page(commands: argparse.ArgumentParser) -> str:
    """The help of every command, as it is printed.

    Examples
    --------
    >>> from argparse import ArgumentParser
    >>> parser = ArgumentParser("tool")
    >>> _ = parser.add_subparsers().add_parser("draw")
    >>> commands_page(parser).splitlines()[4]
    '## `tool draw`'
    """
    lines = ["# Commands", "", "Each command says the same with `--help`.", ""]
    for name, command in subcommands(commands):
        lines += [f"## `{commands.prog} {name}`", "", "```text", command.format_help().rstrip(), "```", ""]
    return "\n".join(lines)


def subcommands(commands: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The commands of a parser with their own parsers."""
    for action in commands._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from action.choices.items()


def room_page(room: str) -> str:
    """The exported names of a room with their docstrings.

    Examples
    --------
    >>> "bondgraph.simulate.simulation.simulate" in room_page("simulate")
    True
    """
    package = importlib.import_module(f"bondgraph.{room}")
    lines = [f"# `bondgraph.{room}`", "", (inspect.getdoc(package) or "").partition("\n")[0], ""]
    for name in exported_names(room):
        value = getattr(package, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            lines += _directive("autoclass" if inspect.isclass(value) else "autofunction", value)
        else:
            lines += [f"`{name}`", f": {value!r}", ""]
    return "\n".join(lines)


def exported_names(room: str) -> Sequence[str]:
    """What a room exports."""
    names: Sequence[str] = importlib.import_module(f"bondgraph.{room}").__all__
    return names


def _directive(kind: str, value: Any) -> list[str]:
    options = [":members:", ":inherited-members: Exception, Enum"] if kind == "autoclass" else []
    lines = [f".. {kind}:: {value.__module__}.{value.__qualname__}", *(f"   {option}" for option in options)]
    return ["```{eval-rst}", *lines, "```", ""]
