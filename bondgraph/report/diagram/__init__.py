"""The parts of a drawn bond graph: labels, layered layout, routes of signals, symbols, and the canvas."""
