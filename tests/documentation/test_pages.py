"""Pages, tutorials and the notebook: scripts run, links lead somewhere, everything there is has its place."""

from __future__ import annotations

import ast
import contextlib
import importlib
import io
import json
import re
import runpy
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import matplotlib as mpl
import pytest

import bondgraph
from bondgraph.cli import COMMANDS
from bondgraph.cli.arguments import parser
from bondgraph.documentation import build_site
from bondgraph.documentation.reference import commands_page, effect_text
from bondgraph.documentation.site import NOTEBOOK, SCRIPTS, environment, run_script, stage_pages
from bondgraph.effects.catalogue import catalogue
from bondgraph.errors import OptionError

PACKAGE = Path(bondgraph.__file__).parent
ROOM = PACKAGE / "documentation"
#: Tutorials that close loops or estimate from nothing; building the site runs them too.
SLOW = {"concepts", "write_effect", "estimate", "close_loop"}


@pytest.fixture
def run_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Runs a tutorial in a folder of its own, in this process; gives what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(ROOM / "scripts")
    monkeypatch.delitem(sys.modules, "sled", raising=False)

    def run(name: str) -> str:
        said = io.StringIO()
        with contextlib.redirect_stdout(said), mpl.rc_context({"backend": "agg"}):
            runpy.run_path(str(ROOM / "scripts" / f"{name}.py"), run_name="__main__")
        return said.getvalue()

    yield run
    sys.modules.pop("sled", None)


def test_there_is_a_script_for_every_tutorial() -> None:
    assert {path.stem for path in (ROOM / "scripts").glob("*.py")} == {*SCRIPTS, "sled"}


def test_declaring_prints_the_module(run_here, tmp_path: Path) -> None:
    said = run_here("declare")
    assert "dx0 = (force - F_runners)/mass" in said
    assert (tmp_path / "sled.svg").read_text().startswith("<svg")


def test_the_mass_of_the_winch_depends_on_its_rotor(run_here) -> None:
    said = run_here("domains")
    assert said.startswith("<BuiltModel winch: 3 states, 1 input")


def test_a_log_is_read_in_the_units_of_the_model(run_here) -> None:
    said = run_here("read_log")
    assert "[100. 100. 120. 120.] N" in said
    assert "[0.    0.111   nan 0.361] m/s" in said


def test_a_log_is_compared_and_a_run_saved(run_here, tmp_path: Path) -> None:
    assert "run1: speed [m/s]" in run_here("compare")
    assert (tmp_path / "compared.svg").exists() and (tmp_path / "run.csv").read_text().startswith("time [s],")


def test_a_stream_raises_the_alarm_of_the_true_change(run_here, tmp_path: Path) -> None:
    said = run_here("online")
    assert "icy morning: icy at" in said
    assert (tmp_path / "filter.json").exists()


def test_things_of_ones_own_work(run_here) -> None:
    said = run_here("extend")
    assert "<BuiltModel coil: 1 state, 1 input, 3 parameters, 1 output>" in said
    mass = re.search(r"ITERATION_LIMIT mass = ([\d.]+)", said)
    assert mass and abs(float(mass[1]) - 95.0) < 8.0  # 500 points at random in a box of 60 to 120 kg


@pytest.mark.slow
def test_an_estimate_holds_the_truth(tmp_path: Path) -> None:
    stage_pages(tmp_path / "stage")
    said = run_script("estimate", tmp_path / "stage")
    row = next(line.split() for line in said.splitlines() if line.startswith("mass"))
    assert float(row[4]) < 95.0 < float(row[5])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "effect"), [("close_loop", "quadratic_loss"), ("write_effect", "air_drag")])
def test_a_loop_finds_the_wind(tmp_path: Path, name: str, effect: str) -> None:
    stage_pages(tmp_path / "stage")
    said = run_script(name, tmp_path / "stage")
    found = re.search(rf"lacks {effect} at body.*?{effect}_body = ([\d.]+) ", said, flags=re.DOTALL)
    assert found and abs(float(found[1]) - 1.5) < 0.15
    assert "The held-out logs confirm the correction" in said


def test_a_script_that_fails_is_named_with_its_error(tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "broken.py").write_text("raise SystemExit('no snow')")
    with pytest.raises(OptionError, match=r"docs: broken.py fails: no snow"):
        run_script("broken", tmp_path)


def test_what_is_not_installed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "furo", None)
    with pytest.raises(OptionError, match=r"docs: furo is not installed - run: pip install 'bondloop\[docs\]'"):
        build_site(tmp_path, parser())
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------------- pages made from the toolkit


def test_every_command_is_on_the_page_of_commands() -> None:
    page = commands_page(parser())
    assert {name for name in COMMANDS if f"## `bondgraph {name}`" not in page} == set()


def test_every_effect_is_told_with_law_units_reference_and_manoeuvre() -> None:
    rows = catalogue()
    for row in rows:
        text = effect_text(row, picture=False)
        assert f"| Law | `{row.law}" in text.replace("\\|", "|")
        for label in ("Domain", "Place", "Shown by", "Reference"):
            assert re.search(rf"^\| {label} \| \S", text, flags=re.MULTILINE), f"{row.name} has no {label}"
        assert all(f"| `{one.name}` |" in text for one in row.coefficients)


ROLE = re.compile(r":(?:func|class|mod|meth|data|attr|exc):`(?:[^`<]*<)?~?(bondgraph[\w.]*)>?`")


def test_what_docstrings_refer_to_exists() -> None:
    lost = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for name in ROLE.findall(path.read_text(encoding="utf-8")):
            if not _exists(name):
                lost.append(f"{path.relative_to(PACKAGE)}: {name}")
    assert lost == []


def _exists(name: str) -> bool:
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            value = importlib.import_module(".".join(parts[:k]))
        except ImportError:
            continue
        for part in parts[k:]:
            if not hasattr(value, part):
                return part in getattr(value, "__annotations__", {})
            value = getattr(value, part)
        return True
    return False


# ---------------------------------------------------------------------- notebook


def _notebook() -> dict:
    return json.loads((ROOM / "notebooks" / NOTEBOOK).read_text(encoding="utf-8"))


def test_the_notebook_is_stored_without_outputs() -> None:
    for cell in _notebook()["cells"]:
        assert not cell.get("outputs") and cell.get("execution_count") is None
        if cell["cell_type"] == "code":
            ast.parse("".join(cell["source"]).replace("%matplotlib inline", ""))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # those of the kernel's own libraries
def test_the_notebook_runs_and_shows_what_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    for name, value in environment().items():
        if name != "MPLBACKEND":
            monkeypatch.setenv(name, value)
    notebook = nbformat.reads(json.dumps(_notebook()), as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    kinds = [
        {kind for output in cell["outputs"] for kind in output.get("data", ())}
        for cell in notebook.cells
        if cell["cell_type"] == "code"
    ]
    shown = [kind for cell in kinds for kind in cell]
    assert shown.count("image/svg+xml") == 2  # declared and corrected graph
    assert shown.count("text/latex") == 2
    assert shown.count("text/html") == 4  # log, simulation, estimate, loop
    assert shown.count("image/png") == 3
    text = "".join(output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", ()))
    assert "lacks quadratic_loss at body" in text


# ---------------------------------------------------------------------- the site


class _Links(HTMLParser):
    """Targets of a page and the places in it that may be targets."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.places: set[str] = set()
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs) -> None:
        given = dict(attrs)
        self.places |= {given[key] for key in ("id", "name") if given.get(key)}
        self.targets += [given[key] for key in ("href", "src", "data") if given.get(key)]
        if tag in ("script", "img", "iframe") or (tag == "link" and given.get("rel") in ("stylesheet", "preload")):
            self.loaded.append(given.get("src") or given.get("href") or "")


def _broken(site: Path) -> list[str]:
    pages = {path.resolve(): _Links(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    broken = []
    for path, page in pages.items():
        for target in page.targets:
            parts = urlsplit(target)
            if parts.scheme or target == "#":
                continue
            to = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            if not to.exists() or (place and to in pages and place not in pages[to].places):
                broken.append(f"{path.relative_to(site.resolve())}: {target}")
    return broken


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<a href="b.html#there">b</a><a href="c.html">c</a><img src="p.svg"><a href="#x">')
    (tmp_path / "b.html").write_text('<p id="here">')
    assert _broken(tmp_path) == ["a.html: b.html#there", "a.html: c.html", "a.html: p.svg", "a.html: #x"]


def _rules() -> list[tuple[str, str]]:
    """Selectors and declarations of the stylesheet, whatever stands around them."""
    text = (ROOM / "pages" / "_static" / "bondgraph.css").read_text(encoding="utf-8")
    plain = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    return [(selector.strip(), body) for selector, body in re.findall(r"([^{}]+)\{([^{}]*)\}", plain)]


def test_code_goes_on_in_the_next_line_and_names_in_tables_break() -> None:
    """Lines of listings were cut at 1600 pixels, and tables of effects scrolled at 400."""
    rules = dict(_rules())
    assert "white-space: pre-wrap; overflow-wrap: anywhere" in rules["div.highlight pre"]
    (cells,) = (body for selector, body in rules.items() if "td code.literal" in selector.split(", "))
    assert "overflow-wrap: anywhere" in cells


def test_pictures_are_dark_wherever_the_page_is() -> None:
    """By the button of the page and by the wish of the system, unless the button says light."""
    turned = [selector for selector, body in _rules() if "invert(" in body]
    assert sorted(turned) == [
        'body:not([data-theme="light"]) article img', 'body[data-theme="dark"] article img',
    ]  # fmt: skip


def test_listings_of_pages_fit_their_column() -> None:
    """A column of Furo shows some 84 characters of code; longer lines are for scripts, which wrap."""
    blocks = (
        (path.name, line)
        for path in (ROOM / "pages").glob("*.md")
        for block in re.findall(r"```(?:python|bash|text)\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        for line in block.splitlines()
    )
    assert [(name, line) for name, line in blocks if len(line) > 84] == []


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # those of the generator's own libraries; its warnings are refused
def test_the_site_is_built_without_warnings_links_hold_and_nothing_needs_a_network(tmp_path: Path) -> None:
    first = build_site(tmp_path / "site", parser())
    site = first.parent
    assert [path.name for path in tmp_path.iterdir()] == ["site"]
    assert _broken(site) == []
    for path in site.rglob("*.html"):
        loaded = _Links(path.read_text(encoding="utf-8")).loaded
        assert [one for one in loaded if urlsplit(one).scheme not in ("", "data")] == [], path
    for path in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*['\"]?(https?:)?//", path.read_text(encoding="utf-8")), path
    page = (site / "close_loop.html").read_text(encoding="utf-8")
    assert "quadratic_loss" in page and "before_after.svg" in page
    assert "<math" in (site / "whole_flow.html").read_text(encoding="utf-8")
