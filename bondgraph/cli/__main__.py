"""``python -m bondgraph.cli``."""

import sys

from bondgraph.cli import main

sys.exit(main())
