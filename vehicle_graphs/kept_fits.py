"""Keys under which the chains note finished fits in a journal, so that the same command goes on where it stopped."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

from bondgraph.data.log import Log


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
