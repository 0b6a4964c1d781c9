"""What the hand-written modules of the tests share."""

from __future__ import annotations

#: Last lines of a module: the function by which it stacks its rows.
STACK = '''

def _stack(x, rows):
    """Rows, each a number or of the batch shape of x, as one array of shape (len(rows), *batch)."""
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
'''
