"""Rendering the runs of a study on a Dask cluster (optional)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from ...errors import RenderError, UsageError, one_line
from .turns import Cluster


@contextmanager
def dask_cluster(address: str) -> Iterator[Cluster]:
    """
    Connect to a Dask scheduler for the time of a context.

    Parameters
    ----------
    address : str
        As in ``tcp://host:8786``. Its workers need this package, the scene at the same path, and
        one thread each: a run uses all cores itself.

    Raises
    ------
    UsageError
        Dask is not installed, or nobody answers.
    """
    try:
        import distributed  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError as error:
        raise UsageError("--dask needs Dask: pip install 'dask[distributed]'") from error
    dask: Any = distributed
    try:
        client = dask.Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise UsageError(f"--dask {address}: no scheduler answers: {one_line(error)}") from error

    def cluster(function: Callable[..., Any], tasks: Sequence[Any]) -> Iterable[tuple[Any, Any]]:
        # Impure: Dask would else answer equal tasks from its memory, with the times of before.
        futures = {client.submit(function, *task, pure=False): task for task in tasks}
        for future in dask.as_completed(futures):
            try:
                yield futures[future], future.result()
            except Exception as error:
                raise RenderError(f"a worker failed: {one_line(error)}") from error

    with client:
        yield cluster
