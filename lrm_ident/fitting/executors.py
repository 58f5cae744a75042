"""Executors (PEP 3148) for parallel work: this process, processes of this machine, or a Dask cluster.

On a cluster Dask's own executor balances the load and repeats a dead worker's tasks on another one.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import connection
from pathlib import Path
from typing import Any, TypeVar

from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.errors import LrmError

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a worker: one thread, as on Dask, for as many workers as cores and the same sums everywhere."""
CONNECT_S, FIRST_WORKER_S = 10.0, 60.0
HEARTBEAT_S = 1.0
"""Pause after which progress is reported though no task has ended: who stops a work must not wait for a task."""
SAME_VERSION = ("lrm-arm", "numpy", "scipy", "distributed", "msgpack", "cloudpickle")
"""Packages that a worker must have in this machine's version; else results differ or cannot be sent."""
Item = TypeVar("Item")
Result = TypeVar("Result")


def in_this_process() -> Executor:
    """Executor of one thread, for work that is short or cannot be pickled."""
    return ThreadPoolExecutor(1)


@contextmanager
def executor_for(
    cluster: str | None = None, own_code: Path | None = None, most: int | None = None
) -> Iterator[Executor]:
    """The executor of a command.

    Args:
        cluster: address of a Dask scheduler (`tcp://host:8786`) or path of its scheduler file; None: processes of this
            machine, as many as it has cores, at most `most`.
        own_code: the Python file of the user's effects, if any. Its classes cannot be pickled, so the work stays in
            this process.

    Raises `LrmError`: no such cluster, the extra is missing, or a worker has other versions.
    """
    if own_code is not None:
        if cluster is not None:
            what = f"effects of {own_code} cannot be sent to a cluster"
            raise LrmError(
                f"{what}; install them on the workers as a package (docs/effects.md), or leave out --cluster"
            )
        with in_this_process() as executor:
            yield executor
    elif cluster is not None:
        with _on_cluster(cluster) as executor:
            yield executor
    else:
        workers = processes_for(most or 10**6)
        with _environment(ONE_THREAD), _processes(workers) as executor:
            yield executor


@contextmanager
def _processes(workers: int) -> Iterator[Executor]:
    """Processes of this machine, which end with this one; at once, whatever they do, if an exception ends the work."""
    others = set(multiprocessing.active_children())
    spawn = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, spawn, initializer=end_with_parent)
    try:
        yield executor
    except BaseException:
        # first the waiting tasks: a pool whose workers die while it holds cancelled ones never ends
        executor.shutdown(wait=False, cancel_futures=True)
        for worker in set(multiprocessing.active_children()) - others:
            worker.kill()
        raise
    executor.shutdown()


def end_with_parent() -> None:
    """Ends this process when the one that started it has ended, even if that was killed: a thread waits for it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent.sentinel,), daemon=True).start()


def _end_after(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def processes_for(tasks: int) -> int:
    """Number of processes in which this machine works on so many tasks."""
    return max(1, min(os.cpu_count() or 1, tasks))


def as_finished(
    executor: Executor, function: Callable[[Item], Result], items: Iterable[Item], progress: OnProgress = silent
) -> Iterator[tuple[int, Result]]:
    """Results of `function` for every item in parallel: (number of the item, result) in order of completion.

    `progress` is called after each, and every `HEARTBEAT_S`; what it raises ends the work.

    Raises what the function raises, and `LrmError` if workers are lost; tasks not yet begun are cancelled.
    """
    waiting = {executor.submit(function, item): number for number, item in enumerate(items)}
    running = set(waiting)
    try:
        while running:
            finished, running = wait(running, HEARTBEAT_S, FIRST_COMPLETED)
            for number, future in enumerate(sorted(finished, key=waiting.__getitem__), start=1):
                result = _result_of(future)
                progress(len(waiting) - len(running) - len(finished) + number, len(waiting))
                yield waiting[future], result
            if not finished:
                progress(len(waiting) - len(running), len(waiting))
    finally:
        for future in waiting:
            future.cancel()


def in_order(
    executor: Executor, function: Callable[[Item], Result], items: Iterable[Item], progress: OnProgress = silent
) -> list[Result]:
    """Results of `as_finished` in the order of the items."""
    return [result for _, result in sorted(as_finished(executor, function, items, progress), key=lambda pair: pair[0])]


def _result_of(future: Future[Result]) -> Result:
    """Result of a task, or its exception; those of lost workers as `LrmError`."""
    try:
        return future.result()
    except BrokenExecutor:
        raise LrmError("a worker process died, perhaps for want of memory; start again") from None
    except CancelledError:
        raise LrmError("the scheduler of the cluster was lost; start again when it is back") from None
    except Exception as error:
        if type(error).__name__ == "KilledWorker":  # Dask's, which may not be installed here
            raise LrmError(f"the same work killed several workers of the cluster: {error}") from None
        raise


@contextmanager
def _on_cluster(where: str) -> Iterator[Executor]:
    """Executor of the Dask cluster at an address or scheduler file. Raises `LrmError`."""
    try:
        distributed: Any = import_module("distributed")
    except ModuleNotFoundError as error:
        raise LrmError(
            f"a cluster needs '{error.name}', which is not installed: pip install 'lrm-arm[cluster]'"
        ) from None
    at: dict[str, Any] = {"address": where}
    if where.endswith(".json") or "://" not in where:
        if not Path(where).is_file():
            raise LrmError(f"--cluster {where}: no such scheduler file; or give an address such as tcp://host:8786")
        at = {"scheduler_file": where}
    for part in ("distributed", "distributed.client", "tornado.application"):  # a lost scheduler is one line
        logging.getLogger(part).setLevel(logging.CRITICAL)
    with warnings.catch_warnings():
        # said below, in one line, as an error
        warnings.simplefilter("ignore", distributed.versions.VersionMismatchWarning)
        try:
            client = distributed.Client(**at, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, KeyError, TimeoutError) as error:
            raise LrmError(f"--cluster {where}: no scheduler answers ({error or type(error).__name__})") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_S)
        except TimeoutError:
            raise LrmError(f"--cluster {where}: the scheduler has no worker; start some (docs/fleet.md)") from None
        versions = client.get_versions(packages=list(SAME_VERSION))
        if faults := version_faults(versions["client"], versions["workers"]):
            raise LrmError(f"--cluster {where}: {faults[0]}; install the same versions there (constraints.txt)")
        with client.get_executor(pure=False) as executor:
            yield executor


def version_faults(here: Mapping[str, Any], workers: Mapping[str, Mapping[str, Any] | None]) -> list[str]:
    """One line for every worker and package of another version than here.

    Args:
        here, workers: what `distributed.Client.get_versions` returns of the client and of each worker.
    """
    faults, ours = [], here["packages"]
    for address, there in sorted(workers.items()):
        theirs = {} if there is None else there["packages"]
        for package in SAME_VERSION:
            if theirs.get(package) != ours.get(package):
                faults.append(
                    f"worker {address} has {package} {theirs.get(package) or 'missing'}, here {ours.get(package)}"
                )
        if _minor(theirs.get("python")) != _minor(ours["python"]):
            faults.append(f"worker {address} runs Python {_minor(theirs.get('python'))}, here {_minor(ours['python'])}")
    return faults


def _minor(python: str | None) -> str:
    return "unknown" if python is None else ".".join(python.split(".")[:2])


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Environment variables for processes that start meanwhile, where they are not set already."""
    added = {name: value for name, value in values.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
