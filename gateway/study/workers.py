"""Who does the sweeps: nobody but us, processes of this machine, or a cluster."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

from gateway.errors import ModelError

CONNECT_S = 10


@contextmanager
def workers(scheduler: str = "", count: int | None = None) -> Iterator[Executor | None]:
    """An executor: a Dask cluster at ``scheduler`` (tcp://...), else ``count`` processes; one process means none.

    Raises ModelError E-SENS-SCHEDULER if no cluster answers or Dask is not installed, E-STUDY-WORKERS.
    """
    if scheduler:
        with _cluster(scheduler) as executor:
            yield executor
        return
    wanted = (os.cpu_count() or 1) if count is None else count
    if wanted < 1:
        raise ModelError("E-STUDY-WORKERS", "study", workers=wanted)
    if wanted == 1:
        yield None
        return
    with ProcessPoolExecutor(wanted, mp_context=get_context("spawn")) as pool:
        yield pool


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client  # noqa: PLC0415 - an optional extra
    except ImportError as error:
        raise ModelError("E-SENS-SCHEDULER", "study", address=address, why="Dask is not installed") from error
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ModelError("E-SENS-SCHEDULER", "study", address=address, why=str(error)) from error
    with client:
        yield client.get_executor(pure=False)
