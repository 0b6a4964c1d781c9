"""``python -m bondgraph``."""

import sys

from bondgraph.cli import main

if __name__ == "__main__":
    sys.exit(main())
