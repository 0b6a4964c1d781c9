"""A Dask cluster: its scheduler gives the tasks of a dead worker to another.

Reference: Rocklin (2015), Dask: parallel computation with blocked algorithms and task scheduling, SciPy.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from bondgraph.errors import ExecutionError, OptionError

#: Seconds within which a scheduler must answer, and one of its workers must be there.
_PATIENCE = 15


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """An executor of the workers of a cluster, by the address of its scheduler (``host:port``).

    Workers need this toolkit, in the same version, and what tasks import besides.

    Raises
    ------
    OptionError
        If Dask is not installed.
    ExecutionError
        If nobody answers at the address, or the cluster has no workers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise OptionError(
            f"dask://{address}: Dask is not installed - run: pip install 'bondloop[dask]'", where=("dask",)
        ) from None
    try:
        client: Any = Client(f"tcp://{address}", timeout=_PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, ValueError) as error:
        raise ExecutionError(
            f"dask://{address}: no scheduler answers ({error or type(error).__name__}) - begin one by: dask scheduler",
            where=(address,),
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise ExecutionError(
                f"dask://{address}: the cluster has no workers - begin some by: dask worker {address}", where=(address,)
            ) from None
        # Two tasks with the same arguments are two tasks.
        yield client.get_executor(pure=False)
