"""An extension of Sphinx: formulas as MathML, and stars in docstrings.

Browsers draw MathML themselves (https://www.w3.org/TR/mathml-core/), and docutils translates TeX to it. The renderers
of Sphinx need a script from a network, a TeX installation, or a copy of one of them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any


def setup(app: Any) -> dict[str, Any]:
    """Register both with Sphinx."""
    app.connect("autodoc-process-docstring", _docstring)
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def _docstring(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    lines[:] = with_plain_stars(lines)


def with_plain_stars(lines: Sequence[str]) -> list[str]:
    r"""A docstring whose stars are stars, not the beginning of emphasis; code and examples as they are.

    Examples
    --------
    >>> with_plain_stars(["Shape (n_x, *batch), ``*args``.", ">>> f(*x)", "*", "", "a*b"])
    ['Shape (n_x, \\*batch), ``*args``.', '>>> f(*x)', '*', '', 'a\\*b']
    """
    found, example = [], False
    for line in lines:
        example = bool(line.strip()) and (example or line.lstrip().startswith(">>> "))
        code = re.split(r"(``.*?``|:\w+:`.*?`)", line)
        text = [part if k % 2 else part.replace("*", r"\*") for k, part in enumerate(code)]
        found.append(line if example else "".join(text))
    return found


def _inline(translator: Any, node: Any) -> None:
    translator.body.append(_mathml(node.astext(), block=False))
    _skip()


def _block(translator: Any, node: Any) -> None:
    translator.body.append(f'<div class="math">{_mathml(node.astext(), block=True)}</div>')
    _skip()


def _mathml(tex: str, block: bool) -> str:
    from docutils.utils.math.latex2mathml import tex2mathml

    text: str = tex2mathml(tex, as_block=block)
    return text


def _skip() -> None:
    """The node is done: its text is in the formula."""
    from docutils.nodes import SkipNode

    raise SkipNode
