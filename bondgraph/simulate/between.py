"""Models whose inputs run another way between samples than their modules say: the same equations, one word changed."""

from __future__ import annotations

import ast

from bondgraph.errors import ModelError
from bondgraph.simulate.model import Model
from bondgraph.syntax import parsed

#: Places of the name and of the way between samples in a row of the inputs of a module.
_NAME, _WAY = 0, 3


def running_otherwise(model: Model, **ways: str) -> Model:
    """The model with some inputs running another way between samples, ``linear``, ``hold`` or ``band limited``.

    Parameters
    ----------
    model
        Of a module, or built from a graph.
    **ways
        By names of inputs. Inputs that follow one later run as it does then.

    Raises
    ------
    ModelError
        If there is no such input or way, or the equations need the rate of an input that is to be held.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> running_otherwise(pendulum(), drive="hold").inputs[0].interpolation
    'hold'
    """
    for name, way in ways.items():
        model.index("input", name)
        if way == "hold" and any(info.rate_of == name for info in model.inputs):
            raise ModelError(
                f"{model.name}: input {name} cannot be held between samples, since the equations need its rate - "
                "leave it straight",
                where=(model.name, name),
            )
    lines = model.text.encode().splitlines(keepends=True)  # places in a syntax tree count bytes
    for name, word in _words(model.text):
        if name in ways:
            row, line = word.lineno - 1, lines[word.lineno - 1]
            lines[row] = line[: word.col_offset] + repr(ways[name]).encode() + line[word.end_col_offset :]
    return Model.from_text(b"".join(lines).decode(), model.name)


def _words(text: str) -> list[tuple[str, ast.expr]]:
    """Names of inputs with the place of the word that says how each runs between samples."""
    for node in parsed(text).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "INPUTS":
            rows = node.value.elts if isinstance(node.value, ast.Tuple) else []
            return [(ast.literal_eval(row.elts[_NAME]), row.elts[_WAY]) for row in rows if isinstance(row, ast.Tuple)]
    return []
