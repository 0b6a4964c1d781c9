"""The command that writes reports again."""

from __future__ import annotations

import argparse
from pathlib import Path

from bondgraph.report.html import rewrite_report


def report(options: argparse.Namespace) -> int:
    """Write the reports of finished folders again."""
    for folder in options.folders:
        print(f"report: {rewrite_report(Path(folder))}")
    return 0
