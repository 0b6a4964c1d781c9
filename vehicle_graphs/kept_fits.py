"""Finished fits of a chain in a folder, so that the same command goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bondgraph.data.log import Log
from bondgraph.files import write_text


def fit_key(model_text: str, known: Mapping[str, float], logs: Sequence[Log]) -> str:
    """Digest of all that a fit depends on: the equations, where it starts, the logs.

    Examples
    --------
    >>> fit_key("x", {}, []) == fit_key("x", {"a": 1.0}, [])
    False
    """
    content = hashlib.sha256(repr((model_text, sorted(known.items()))).encode())
    for log in logs:
        content.update(log.name.encode() + log.time.tobytes())
        for channel in log.channels.values():
            content.update(channel.name.encode() + channel.values.tobytes())
    return content.hexdigest()[:24]


@dataclass(frozen=True)
class KeptFits:
    """A folder of fits by their keys; without one nothing is kept.

    Examples
    --------
    >>> KeptFits().get("4f")
    """

    folder: Path | None = None

    def get(self, key: str) -> dict[str, Any] | None:
        """The content that was kept, or None."""
        path = None if self.folder is None else self.folder / f"{key}.json"
        if path is None or not path.is_file():
            return None
        kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return kept

    def put(self, key: str, content: Mapping[str, Any]) -> None:
        """Keep the content of a fit that is finished."""
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_text(self.folder / f"{key}.json", json.dumps(dict(content), indent=1))
