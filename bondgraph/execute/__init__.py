"""Execute: the same tasks in this process, in threads, in processes or on a Dask cluster.

Everything that repeats (starts, members of a batch, profile points, repetitions, cases of a study) is a function of
plain values and takes an executor of :mod:`concurrent.futures`. Results are put in the order of their tasks and random
numbers belong to tasks, so that an answer is the same in every bit whoever computes it, on machines of one kind.
"""

from typing import TYPE_CHECKING

from bondgraph.lazy import exported

if TYPE_CHECKING:
    from bondgraph.execute.executors import open_executor as open_executor
    from bondgraph.execute.shared import Shared as Shared
    from bondgraph.execute.tasks import as_done as as_done
    from bondgraph.execute.tasks import in_order as in_order
else:
    __getattr__, __dir__, __all__ = exported(
        __name__,
        {
            "execute.executors": "open_executor",
            "execute.shared": "Shared",
            "execute.tasks": "as_done in_order",
        },
    )
