"""A correction as the Python lines by which a declaration becomes the corrected one, and as a patch of its file.

Lines are run on the declared graph before they are given: those that do not make the corrected graph are withheld.
"""

from __future__ import annotations

import ast
import difflib
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sympy import Integer

from bondgraph.declare.editing import copy
from bondgraph.declare.files import load_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.loading import is_file_reference, split_reference
from bondgraph.declare.quantities import Integral, NamedSignal, Parameter, ParameterStart, Start
from bondgraph.errors import BondGraphError
from bondgraph.files import write_text
from bondgraph.report.python_expressions import UnwritableError, Writer
from bondgraph.report.python_nodes import write_nodes
from bondgraph.syntax import parsed
from bondgraph.text import few, inflected


def correction_lines(before: BondGraph, after: BondGraph) -> str:
    """Python lines that make one graph, called ``g``, the other; empty where there are none that do so exactly.

    They stand before the ``return g`` of a declaration: what was added with its names, units, meanings and bounds, laws
    that were changed, inputs that run another way between samples, and the estimated values.

    Examples
    --------
    >>> import bondgraph as bg
    >>> def sled(loss: float) -> bg.BondGraph:
    ...     g = bg.BondGraph("sled")
    ...     body = g.one_junction("body", bg.TRANSLATION)
    ...     g.inertance("mass", g.parameter("m", 80.0 if loss == 0.0 else 95.0, "kg"), at=body, state="v")
    ...     if loss:
    ...         c = g.parameter("c", loss, "N/(m/s)^2", "air", (0.0, 8.0))
    ...         g.resistance("air", lambda v: c * v * abs(v), at=body)
    ...     return g
    >>> print(correction_lines(sled(0.0), sled(1.5)))
    from bondgraph.declare.editing import with_values
    <BLANKLINE>
    c = g.parameter('c', 1.5, 'N/(m/s)^2', 'air', (0.0, 8.0))
    g.resistance('air', lambda flow: c * flow * abs(flow), at='body')
    g = with_values(g, {'m': 95.0})
    """
    return _tried(before, after)[0]


def _tried(before: BondGraph, after: BondGraph) -> tuple[str, str]:
    """The lines, and where there are none that make the other graph what cannot be written."""
    writer = Writer(after.quantities)
    try:
        _write_quantities(writer, before, after)
        write_nodes(writer, before, after)
        _write_starts(writer, before, after)
        _write_ways(writer, before, after)
        _write_values(writer, before, after)
    except UnwritableError as error:
        return "", str(error)
    except SyntaxError:
        return "", "a law that is no Python expression"
    imports = [f"from {module} import {', '.join(sorted(names))}" for module, names in sorted(writer.imports.items())]
    text = "\n".join([*imports, *([""] if imports else []), *writer.lines])
    missing = _missing(text, before, after)
    return ("", missing) if missing else (text, "")


def _missing(text: str, before: BondGraph, after: BondGraph) -> str:
    """Differences of a graph from another after lines were run on it, in words; empty where it is that graph."""
    names: dict[str, Any] = {"g": copy(before)}
    try:
        exec(compile(text, "<correction>", "exec"), names)
    except (BondGraphError, TypeError, ValueError, NameError, SyntaxError) as error:
        return f"lines that run ({str(error).splitlines()[0]})" if str(error) else "lines that run"
    made: BondGraph = names["g"]
    if made == after:
        return ""
    other = [name for name, node in after.nodes.items() if made.nodes.get(name) != node]
    starts = [name for name in other if name in made.nodes and made.nodes[name].laws == after.nodes[name].laws]
    known = {one.name: one for one in made.quantities.values()}
    values = [one.name for one in after.quantities.values() if known.get(one.name) != one]
    said = [f"where {few(starts)} {inflected(starts, 'starts', 'start')}"] if starts else []
    laws = [name for name in other if name not in starts]
    said += [f"the {inflected(laws, 'law', 'laws')} of {few(laws)}"] if laws else []
    said += [f"the {inflected(values, 'definition', 'definitions')} of {few(values)}"] if values else []
    return " and ".join(said) or "a part of the graph that is no element and no quantity"


def _write_quantities(writer: Writer, before: BondGraph, after: BondGraph) -> None:
    known = {quantity.name for quantity in before.parameters}
    for one in after.parameters:
        if one.name not in known:
            writer.lines.append(f"{writer.variable(one.name)} = g.parameter({_parameter(one)})")
    for group, method in (("integrals", "integral"), ("signals", "signal")):
        old = {quantity.name for quantity in getattr(before, group)}
        new = [quantity for quantity in getattr(after, group) if quantity.name not in old]
        for place, quantity in enumerate(new):
            _write_defined(writer, quantity, method, [one.name for one in new[place + 1 :]])
        for quantity in new if method == "integral" else ():
            if quantity.name in writer.later:
                revise = writer.use("bondgraph.declare.revision", "revise_integral")
                writer.lines.append(f"{revise}(g, {quantity.name!r}, {writer.expression(quantity.of)})")
    outputs = {output.name: output for output in before.outputs}
    for output in after.outputs:
        if output.name in outputs and output != outputs[output.name]:
            revise = writer.use("bondgraph.declare.revision", "revise_output")
            writer.lines.append(f"{revise}(g, {output.name!r}, {writer.expression(output.expression)})")


def _parameter(one: Parameter) -> str:
    shown = [repr(one.name), repr(float(one.shown(one.value))), repr(one.display_unit or one.unit), repr(one.meaning)]
    if one.bounds is not None:
        shown.append(repr(tuple(float(one.shown(bound)) for bound in one.bounds)))
    return ", ".join(shown)


def _write_defined(writer: Writer, quantity: Integral | NamedSignal, method: str, later: Sequence[str]) -> None:
    """A line for an integral or a signal; an integral of what is declared ``later`` is given its rate after that."""
    value = quantity.of if isinstance(quantity, Integral) else quantity.expression
    if isinstance(quantity, NamedSignal) and quantity.guess is not None:
        raise UnwritableError(f"{quantity.name}, which is solved for")
    if method == "integral" and {one.name for one in value.free_symbols} & {*later}:
        writer.later.add(quantity.name)
        value = Integer(0)
    text = writer.expression(value, {quantity.name})
    own = f"lambda {quantity.name}: " if method == "integral" and quantity.name in text else ""
    variable = writer.variable(quantity.name)
    start = _begun(quantity) if isinstance(quantity, Integral) else ""
    writer.lines.append(
        f"{variable} = g.{method}({quantity.name!r}, {own}{text}, {quantity.unit!r}, {quantity.meaning!r}{start})"
    )


def _begun(one: Integral) -> str:
    """Where an integral begins, as the argument that says so."""
    if isinstance(one.start, ParameterStart):
        return f", initial={str(one.start)!r}"
    if one.start is not None:
        return f", initial=({str(one.start)!r}, {one.initial!r})"
    return f", initial={one.initial!r}" if one.initial else ""


def _write_starts(writer: Writer, before: BondGraph, after: BondGraph) -> None:
    """Starts of declared storages and integrals at signals of a log: that of a mass whose sensor is late."""
    known = {one.name: one.start for one in before.integrals} | {
        name: node.starts[0] if node.starts else None for name, node in before.nodes.items() if not node.is_field
    }
    begun = [(one.name, one.start) for one in after.integrals]
    begun += [(name, node.starts[0]) for name, node in after.nodes.items() if node.starts and not node.is_field]
    for name, start in begun:
        if name in known and isinstance(start, Start) and start != known[name]:
            revise = writer.use("bondgraph.declare.revision", "revise_start")
            more = "" if start.factor == 1.0 else f", {start.factor!r}"
            writer.lines.append(f"{revise}(g, {name!r}, {start.signal!r}{more})")


def _write_ways(writer: Writer, before: BondGraph, after: BondGraph) -> None:
    """Inputs that run another way between samples, and what their own declarations could say instead."""
    old = {one.name: one.interpolation for one in before.flatten().inputs}
    changed = [one for one in after.flatten().inputs if old.get(one.name, one.interpolation) != one.interpolation]
    for way in dict.fromkeys(one.interpolation for one in changed):
        names = [one.name for one in changed if one.interpolation == way]
        plain = all(map(str.isidentifier, names))
        given = ", ".join(f"{name}={way!r}" for name in names) if plain else f"**{dict.fromkeys(names, way)!r}"
        said = "hold=True" if way == "hold" else f"between={way!r}"
        told = f"or {said} where {' and '.join(names)} {inflected(names, 'is', 'are')} declared"
        function = writer.use("bondgraph.declare.editing", "with_inputs_between")
        writer.lines.append(f"g = {function}(g, {given})  # {told}")


def _write_values(writer: Writer, before: BondGraph, after: BondGraph) -> None:
    old = {one.name: one for one in before.parameters}
    same = [one for one in after.parameters if one.name in old]
    values = {one.name: float(one.value) for one in same if one.value != old[one.name].value}
    bounds = {one.name: one.bounds for one in same if one.bounds != old[one.name].bounds and one.bounds is not None}
    for name, changed in (("with_bounds", bounds), ("with_values", values)):
        if changed:
            writer.lines.append(f"g = {writer.use('bondgraph.declare.editing', name)}(g, {changed!r})")


#: Comments above the lines in a patch.
_FOUND = "# found by closing the loop on logs"
_CONTRADICTED = "# asked for by training logs when the loop was closed, but contradicted by the logs: see the report"


def declaration_patch(reference: str, before: BondGraph, after: BondGraph, contradicted: bool = False) -> str:
    """A unified diff of the Python file of a declaration; empty where its lines have no one place, or none are known.

    The file is a function that ends in ``return`` of a name, and is left as it is: the patch is for the user to apply,
    and is given only where the patched file declares the corrected graph.

    Parameters
    ----------
    reference
        ``FILE.py`` or ``FILE.py:function``, as a command got it.
    before, after
        The declared graph, as the file gives it, and the corrected one.
    contradicted
        The logs contradict what was added; a comment says so.
    """
    if not is_file_reference(reference):
        return ""
    path, name = Path(split_reference(reference)[0]), split_reference(reference)[1]
    text = correction_lines(before, after)
    source = path.read_text(encoding="utf-8")
    place = _return_of(source, name or before.name)
    if not text or place is None:
        return ""
    line, variable = place
    renamed = text if variable == "g" else _renamed(text, variable)
    lines = source.splitlines(keepends=True)
    indent = lines[line - 1][: len(lines[line - 1]) - len(lines[line - 1].lstrip())]
    added = [
        f"{indent}{_CONTRADICTED if contradicted else _FOUND}\n",
        *(f"{indent}{one}\n" for one in renamed.splitlines() if one),
    ]
    patched = [*lines[: line - 1], *added, *lines[line - 1 :]]
    if not _declares("".join(patched), path, name, after):
        return ""
    return "".join(difflib.unified_diff(lines, patched, f"a/{path.name}", f"b/{path.name}"))


def _return_of(source: str, name: str) -> tuple[int, str] | None:
    """Line of the only ``return`` of a top-level function, and the name that it returns."""
    for node in parsed(source).body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            returns = [one for one in ast.walk(node) if isinstance(one, ast.Return)]
            last = node.body[-1]
            if len(returns) == 1 and isinstance(last, ast.Return) and isinstance(last.value, ast.Name):
                return last.lineno, last.value.id
    return None


def _renamed(text: str, variable: str) -> str:
    tree = parsed(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and node.id == "g":
            node.id = variable
    return ast.unparse(tree)


def _declares(source: str, path: Path, name: str, after: BondGraph) -> bool:
    """Whether a text in the place of a file declares a graph; it is tried beside copies of nothing but itself."""
    with tempfile.TemporaryDirectory() as folder:
        tried = Path(folder) / path.name
        tried.write_text(source, encoding="utf-8")
        sys.path.insert(0, str(path.parent.resolve()))  # what the file imports beside it
        try:
            return bool(load_graph(f"{tried}:{name}" if name else str(tried)) == after)
        except BondGraphError:
            return False
        finally:
            sys.path.remove(str(path.parent.resolve()))


def write_python(
    folder: Path, declared: BondGraph, corrected: BondGraph, reference: str = "", contradicted: bool = False
) -> list[str]:
    """Write ``corrected_lines.py`` and, for the file of a declaration, ``correction.patch``; the sentences on them.

    Both, and the sentences, say so where the logs contradict what was added (``contradicted``).

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    text, missing = _tried(declared, corrected)
    if not text:
        why = f"it cannot be written {missing}" if missing.startswith("where ") else f"they cannot write {missing}"
        where = folder / "corrected_graph.json"
        return [f"No Python lines write this correction exactly ({why}); it stands in {where}"]
    head = "# before the return of the declaration, whose graph is g\n" + (f"{_CONTRADICTED}\n" if contradicted else "")
    write_text(folder / "corrected_lines.py", f"{head}{text}\n")
    told = _only(text) or ("the logs contradict what they add" if contradicted else "")
    only = f" ({told})" if told else ""
    said = [f"Python lines for the declaration{only}: {folder / 'corrected_lines.py'}"]
    patch = declaration_patch(reference, declared, corrected, contradicted) if reference else ""
    if patch:
        write_text(folder / "correction.patch", patch)
        target = split_reference(reference)[0]
        said.append(f"as a patch of it{only}: patch {target} {folder / 'correction.patch'}")
    return said


def _only(text: str) -> str:
    r"""What lines set that add no law, in words; empty of lines that add or change one.

    Examples
    --------
    >>> _only("from bondgraph.declare.editing import with_values\n\ng = with_values(g, {'m': 95.0})")
    'they set estimated values, no law'
    >>> _only("g.resistance('air', lambda flow: c * flow, at='body')")
    ''
    """
    own = [line for line in text.splitlines() if line and not line.startswith("from ")]
    told = {
        "g = with_inputs_between(": "how inputs run between samples", "g = with_bounds(": "bounds",
        "g = with_values(": "estimated values", "revise_start(": "where states start",
    }  # fmt: skip
    known = [next((words for start, words in told.items() if line.startswith(start)), "") for line in own]
    return f"they set {' and '.join(dict.fromkeys(known))}, no law" if known and all(known) else ""
