"""Data: measured logs in and out, checked before any computation."""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.data.log import Log as Log
    from bondgraph.data.log import LogChannel as LogChannel
    from bondgraph.data.log import MatchedLog as MatchedLog
    from bondgraph.data.matching import match as match
    from bondgraph.data.read import read_log as read_log
    from bondgraph.data.write import write_log as write_log
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "data.log": "Log LogChannel MatchedLog",
            "data.matching": "match",
            "data.read": "read_log",
            "data.write": "write_log",
        },
    )
