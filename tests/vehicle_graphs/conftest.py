"""Models of the vehicles, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from bondgraph.simulate.model import Model

GENERATED = Path(__file__).resolve().parents[2] / "generated"


@pytest.fixture(scope="session")
def ranger() -> Model:
    """The generated module of the whole vehicle."""
    return Model.from_file(GENERATED / "ranger_full.py")
