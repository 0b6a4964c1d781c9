"""The command that builds the documentation."""

from __future__ import annotations

import argparse

from bondgraph.cli.arguments import parser
from bondgraph.cli.printing import say
from bondgraph.documentation import build_site


def docs(options: argparse.Namespace) -> int:
    """Build the documentation to static HTML."""
    print(f"documentation: {build_site(options.out, parser(), say)}")
    return 0
