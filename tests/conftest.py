"""Fixtures shared by all rooms' tests."""

from __future__ import annotations

import collections
import hashlib
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

# a busy machine may take seconds for what takes none otherwise: no example has a time, nor has drawing one
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


def pytest_configure() -> None:
    """Let Python keep what it compiles, whatever it was told.

    Workers, and the processes that tests start, import the toolkit anew; each would compile its six hundred modules.
    """
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """The tests of a module on one worker, so that what they share is fitted and compiled once."""
    if config.getoption("dist") != "load":
        return None
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False  # the order is that of the next function
    return LoadFileScheduling(config, log)


#: Modules that are few tests and take long: type checks, and the demonstration of every missing effect.
LONG = ("test_house.py", "test_demo.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with long modules, then those of many tests, so that no worker waits for the last one."""
    many = collections.Counter(one.path for one in items)
    items.sort(key=lambda one: (one.path.name not in LONG, -many[one.path]))


SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


#: Rooms whose tests look at pictures only where they are marked so.
UNDRAWN = ("cli", "correct", "estimate", "exchange", "vehicle_graphs")


@pytest.fixture(autouse=True)
def _pictures(request: pytest.FixtureRequest) -> None:
    """Reports of commands have eight pictures, which take longer than all else that a command does."""
    room = request.path.relative_to(Path(__file__).parent).parts[0]
    if room in UNDRAWN and request.node.get_closest_marker("rendered") is None:
        request.getfixturevalue("undrawn")


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and say what they hold in place of being rendered: for tests that do not look at pictures."""
    from bondgraph.report import embedding, figures

    def picture(figure: Any, ending: str = "svg", **_: Any) -> bytes:
        return f"{ending} {_contents(figure)}".encode()

    monkeypatch.setattr(embedding, "_uri", lambda figure: embedding.svg_uri(picture(figure).decode()))
    monkeypatch.setattr(embedding, "_narrow", lambda figure: embedding.svg_uri(f"narrow {picture(figure).decode()}"))
    monkeypatch.setattr(figures, "picture", picture)


def _contents(figure: Any) -> str:
    """Digest of the lines, texts, dots and bands of a figure."""
    found = hashlib.sha256(repr(figure.get_size_inches().tolist()).encode())
    texts = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for axes in figure.axes:
        legend = axes.get_legend()
        titles = [axes.get_title(loc=place) for place in ("left", "center", "right")]
        found.update(repr([*titles, axes.get_xlabel(), axes.get_ylabel()]).encode())
        texts += [*axes.texts, *(legend.get_texts() if legend else ())]
        numbers = [*axes.get_xlim(), *axes.get_ylim()], *(line.get_xydata() for line in axes.lines)
        paths = [path.vertices for one in axes.collections for path in one.get_paths()]
        for values in (*numbers, *(one.get_offsets() for one in axes.collections), *paths):
            found.update(np.asarray(values, dtype=float).tobytes())
    found.update(repr([text.get_text() for text in texts]).encode())
    return found.hexdigest()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of measured and reference data beside the checkout; the test is skipped where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the measured and reference data in ../shared/data, which is not part of this repository")
    return SHARED_DATA
