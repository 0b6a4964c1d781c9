"""The site: pages, scripts and their outputs staged in a folder, and built by Sphinx to HTML that needs no network.

Sphinx (https://www.sphinx-doc.org) reads docstrings and checks links; MyST reads Markdown and executes the notebook;
Furo is a theme without fonts or scripts of other servers. All are in the extra ``docs``.
"""

from __future__ import annotations

import argparse
import ast
import importlib.resources
import importlib.util
import io
import os
import shutil
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bondgraph.documentation.reference import write_reference
from bondgraph.errors import OptionError
from bondgraph.files import output_folder, write_text
from bondgraph.text import inflected
from bondgraph.version import __version__

#: Scripts that pages include; ``sled`` is imported by the others.
SCRIPTS = (
    "concepts", "declare", "domains", "write_effect", "read_log", "compare", "estimate", "close_loop", "online",
    "extend",
)  # fmt: skip
NOTEBOOK = "whole_flow.ipynb"
_LIBRARIES = ("sphinx", "furo", "myst_nb", "ipykernel")
#: Characters of a printed sentence that a page of 800 px shows in one line.
_WIDTH = 90
#: Seconds after which a cell of the notebook has failed.
_CELL = 300

_OPTIONS: Mapping[str, Any] = {
    "project": "bondgraph",
    "release": __version__,
    "extensions": ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_nb", "bondgraph.documentation.extension"],
    "html_theme": "furo",
    "html_title": f"bondgraph {__version__}",
    "html_show_sphinx": False,
    "html_show_copyright": False,
    "html_copy_source": False,
    "html_math_renderer": "mathml",
    "html_static_path": ["_static"],
    "html_css_files": ["bondgraph.css"],
    "html_theme_options": {"light_css_variables": {"font-stack": "system-ui, sans-serif"}},
    "myst_enable_extensions": ["deflist", "dollarmath", "colon_fence"],
    "myst_heading_anchors": 3,
    "nb_execution_mode": "force",
    "nb_execution_timeout": _CELL,
    "nb_execution_raise_on_error": True,
    "nb_merge_streams": True,
    "autodoc_typehints": "none",
    "autodoc_member_order": "bysource",
    "napoleon_use_rtype": False,
    "napoleon_attr_annotations": False,
    "pygments_style": "friendly",
}


def build_site(folder: str | Path, commands: argparse.ArgumentParser, say: Callable[[str], None] = print) -> Path:
    """Build the documentation to static HTML, whose pages open as files.

    Parameters
    ----------
    folder
        Where the pages are written; what is in it of an earlier build is replaced.
    commands
        The parser of the command line, whose help is a page.
    say
        Told every stage.

    Returns
    -------
    Path
        Of the first page.

    Raises
    ------
    OptionError
        If the extra ``docs`` is not installed, a script fails, or the generator has a warning.
    """
    lacking = [name for name in _LIBRARIES if importlib.util.find_spec(name) is None]
    if lacking:
        raise OptionError(
            f"docs: {', '.join(lacking)} {inflected(lacking, 'is', 'are')} not installed - run: "
            "pip install 'bondloop[docs]'",
            where=tuple(lacking),
        )
    target = output_folder(Path(folder)).resolve()
    with tempfile.TemporaryDirectory() as made:
        stage = Path(made) / "pages"
        stage_pages(stage)
        for script in SCRIPTS:
            say(f"running {script}.py")
            run_script(script, stage)
        say("drawing the dictionary of effects")
        write_reference(stage, commands)
        say("building pages; the notebook runs")
        built = Path(made) / "built" / "html"  # MyST leaves a folder of executed cells beside it
        _build(stage, built, Path(made) / "trees")
        shutil.copytree(built, target, dirs_exist_ok=True)
    return target / "index.html"


def stage_pages(stage: Path) -> None:
    """Copy pages, scripts and the notebook into a folder."""
    room = importlib.resources.files("bondgraph.documentation")
    with importlib.resources.as_file(room) as own:
        hidden = shutil.ignore_patterns("__pycache__", ".ipynb_checkpoints")
        shutil.copytree(own / "pages", stage, ignore=hidden)
        shutil.copytree(own / "scripts", stage / "scripts", ignore=hidden)
        shutil.copy(own / "notebooks" / NOTEBOOK, stage)


def run_script(name: str, stage: Path) -> str:
    """Run a script of the staged pages; what it writes and prints (``NAME.txt``) lies in ``made/NAME``.

    Returns
    -------
    str
        What it printed.

    Raises
    ------
    OptionError
        If it fails.
    """
    folder = stage / "made" / name
    folder.mkdir(parents=True)
    run = subprocess.run(
        [sys.executable, "-W", "error", str(stage / "scripts" / f"{name}.py")], cwd=folder, capture_output=True,
        encoding="utf-8", env=environment(), check=False,
    )  # fmt: skip
    if run.returncode:
        raise OptionError(f"docs: {name}.py fails: {run.stderr.strip()}", where=(name,))
    write_text(folder / f"{name}.txt", wrapped(run.stdout))
    return run.stdout


def wrapped(text: str) -> str:
    """Text with its sentences wrapped; tables and Python lines stay as they are, and are scrolled where they are wider.

    Examples
    --------
    >>> [len(line) for line in wrapped(30 * "word ").splitlines()]
    [89, 59]
    >>> wrapped("name" + 100 * " " + "value") == "name" + 100 * " " + "value"
    True
    """
    return "\n".join(_wrapped_line(line) for line in text.split("\n"))


def _wrapped_line(line: str) -> str:
    indent = line[: len(line) - len(line.lstrip())]
    if len(line) <= _WIDTH or "   " in line.strip() or _is_python(line):
        return line
    return textwrap.fill(line.strip(), _WIDTH, initial_indent=indent, subsequent_indent=indent, break_long_words=False)


def _is_python(line: str) -> bool:
    try:
        ast.parse(line.strip())
    except SyntaxError:
        return False
    return True


def environment() -> dict[str, str]:
    """The environment of a process that imports this very package, draws without a screen and prints in UTF-8."""
    own = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (own, os.environ.get("PYTHONPATH"))))
    drawn = {"MPLBACKEND": "agg", "PYTHONIOENCODING": "utf-8", "PYTHONDONTWRITEBYTECODE": "1"}
    return {**os.environ, **drawn, "PYTHONPATH": path}


def _build(stage: Path, target: Path, trees: Path) -> None:
    from sphinx.application import Sphinx
    from sphinx.errors import SphinxError

    warnings = io.StringIO()
    kept = dict(os.environ)
    os.environ.update({name: value for name, value in environment().items() if name != "MPLBACKEND"})
    try:
        app = Sphinx(
            str(stage), None, str(target), str(trees), "html", confoverrides=dict(_OPTIONS), status=None,
            warning=warnings, freshenv=True,
        )  # fmt: skip
        app.build(force_all=True)
    except SphinxError as error:
        raise OptionError(f"docs: the pages cannot be built: {error}", where=("docs",)) from None
    finally:
        os.environ.clear()
        os.environ.update(kept)
    told = warnings.getvalue().strip()
    if told:
        raise OptionError(f"docs: the pages have faults: {told}", where=("docs",))
