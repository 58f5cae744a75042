"""The one executor: this process, processes of this machine, a Dask cluster of two workers."""

from __future__ import annotations

import os
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest

from lrm_ident.fitting.executors import (
    SAME_VERSION,
    as_finished,
    executor_for,
    in_order,
    in_this_process,
    version_faults,
)
from lrm_math.errors import LrmError
from tests.conftest import EXAMPLE
from tests.support.commands import stderr_of


def squared(number: int) -> int:
    return number * number


def refused(number: int) -> int:
    raise LrmError(f"number {number}")


def dies_once(marker: str) -> str:
    """Ends its own process the first time."""
    path = Path(marker)
    if not path.exists():
        path.write_text("died")
        os._exit(1)
    return "done"


def test_results_come_with_their_numbers_and_progress() -> None:
    ticks: list[tuple[int, int]] = []
    with in_this_process() as executor:
        found = list(as_finished(executor, squared, range(5), lambda done, of: ticks.append((done, of))))
        assert sorted(found) == [(k, k * k) for k in range(5)]
        assert ticks == [(k + 1, 5) for k in range(5)]
        with pytest.raises(LrmError, match="number 0"):
            in_order(executor, refused, range(3))


@pytest.mark.slow
def test_local_processes_and_what_they_raise() -> None:
    with executor_for(most=1) as executor:
        assert in_order(executor, squared, range(4)) == [0, 1, 4, 9]
        with pytest.raises(LrmError, match="number"):
            in_order(executor, refused, range(2))


@pytest.mark.slow
def test_a_dead_local_process_is_one_line(tmp_path: Path) -> None:
    with executor_for(most=1) as executor, pytest.raises(LrmError, match="a worker process died"):
        in_order(executor, dies_once, [str(tmp_path / "marker")])


def test_a_cancelled_future_is_a_lost_scheduler() -> None:
    class LostWorkers(Executor):
        def submit(self, *_: object, **__: object) -> Future[int]:  # type: ignore[override]
            future: Future[int] = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    with pytest.raises(LrmError, match="scheduler of the cluster was lost"):
        in_order(LostWorkers(), squared, [1])


def test_versions_of_workers_are_compared() -> None:
    here = {"packages": {**dict.fromkeys(SAME_VERSION, "1.0"), "python": "3.11.7.final.0"}}
    patch = {"packages": {**here["packages"], "python": "3.11.9.final.0"}}
    old = {"packages": {**here["packages"], "numpy": "0.9", "python": "3.12.1.final.0"}}
    assert version_faults(here, {"tcp://a": patch}) == []
    assert version_faults(here, {"tcp://a": patch, "tcp://b": old}) == [
        "worker tcp://b has numpy 0.9, here 1.0",
        "worker tcp://b runs Python 3.12, here 3.11",
    ]
    assert len(version_faults(here, {"tcp://c": None})) == len(SAME_VERSION) + 1


def test_no_such_cluster_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(LrmError, match=r"no such scheduler file"), executor_for(str(tmp_path / "none.json")):
        pass
    with pytest.raises(LrmError, match=r"effects of own\.py cannot be sent"), executor_for("tcp://a:1", Path("own.py")):
        pass


def test_the_missing_extra_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    words = ("selftest", "lrm-lab", EXAMPLE, "--only", "backlash@joint2", "--cluster", "tcp://scheduler:8786")
    assert "pip install 'lrm-arm[cluster]'" in stderr_of(*words)


@pytest.mark.slow
def test_a_cluster_gives_the_same_and_retries_a_dead_worker(two_workers: str, tmp_path: Path) -> None:
    with executor_for(two_workers) as executor:
        assert in_order(executor, squared, range(20)) == [k * k for k in range(20)]
        with pytest.raises(LrmError, match="number"):
            in_order(executor, refused, range(2))
        assert in_order(executor, dies_once, [str(tmp_path / "marker")]) == ["done"]


@pytest.mark.slow
def test_no_scheduler_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    monkeypatch.setattr("lrm_ident.fitting.executors.CONNECT_S", 0.5)
    with pytest.raises(LrmError, match="no scheduler answers"), executor_for("tcp://127.0.0.1:1"):
        pass
