"""Arrays of the run-time rooms: vector axis first, batch axes last."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from bondgraph.errors import ModelError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


#: Bytes of a cache line, which is also the longest vector of a processor.
_LINE = 64
#: Numbers of a cache line.
LINE = _LINE // np.dtype(np.float64).itemsize


def aligned_zeros(*shape: int) -> FloatArray:
    """Zeros that begin at a cache line, so that no vector of a row of 16 lies across two lines.

    Examples
    --------
    >>> rows = aligned_zeros(3, 16)
    >>> rows.shape, rows.ctypes.data % 64
    ((3, 16), 0)
    """
    size = math.prod(shape)
    memory = np.zeros(size + LINE)
    first = -memory.ctypes.data % _LINE // memory.itemsize
    return memory[first : first + size].reshape(shape)


def member_columns(name: str, values: npt.ArrayLike, rows: int, members: int) -> FloatArray:
    """``values`` of shape (rows,) or (rows, members) as a new contiguous array (rows, members).

    Raises
    ------
    ModelError
        If the shape is neither, naming the argument.

    Examples
    --------
    >>> member_columns("theta", [1.0, 2.0], rows=2, members=3).shape
    (2, 3)
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape == (rows,):
        return np.ascontiguousarray(np.repeat(array[:, np.newaxis], members, axis=1))
    if array.shape != (rows, members):
        raise ModelError(
            f"{name} has shape {array.shape} where ({rows},) or ({rows}, {members}) is needed"
            " - one row per quantity, one column per member",
            where=(name,),
        )
    return np.array(array, order="C")


def count_members(arrays: Iterable[npt.ArrayLike | None]) -> int:
    """Number of members of a batch: the columns of those arguments that have any, 1 where none has.

    Examples
    --------
    >>> count_members([None, np.zeros((4, 7)), np.zeros(3)])
    7
    """
    counts = {np.shape(array)[1] for array in arrays if array is not None and np.ndim(array) == 2}
    if len(counts) > 1:
        raise ModelError(f"the batch is ambiguous: arguments have {sorted(counts)} columns - give each as many members")
    return counts.pop() if counts else 1
