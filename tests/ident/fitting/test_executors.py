"""The one executor: this process, processes of this machine, a Dask cluster of two workers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.fitting.executors import (
    SAME_VERSION,
    as_finished,
    executor_for,
    in_order,
    in_this_process,
    version_faults,
)
from lrm_ident.fitting.progress import TimeOfParts
from lrm_math.errors import LrmError
from tests.conftest import EXAMPLE, ROOT
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


PARENT = """
from tests.ident.fitting.test_executors import says_its_number_and_works
from lrm_ident.fitting.executors import executor_for, in_order
if __name__ == "__main__":
    with executor_for(most=1) as executor:
        in_order(executor, says_its_number_and_works, [{marker!r}])
"""


def says_its_number_and_works(marker: str) -> None:
    Path(f"{marker}.new").write_text(str(os.getpid()))
    Path(f"{marker}.new").rename(marker)
    while True:
        sum(range(10_000))


def worker_of(marker: Path) -> int:
    """Number of the worker's process, once it works."""
    for _ in range(600):
        if marker.exists():
            return int(marker.read_text())
        time.sleep(0.1)
    raise AssertionError("the worker did not begin")


def ends(process: int) -> bool:
    """Whether a process ends; a minute is long enough on any machine, and what is at work here never ends itself."""
    for _ in range(600):
        try:
            state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.1)
    os.kill(process, signal.SIGKILL)
    return False


@pytest.mark.slow
def test_workers_end_with_a_parent_that_was_killed(tmp_path: Path) -> None:
    """Before: they went on until their task was done, and some tasks take minutes."""
    script, marker = tmp_path / "parent.py", tmp_path / "worker"
    script.write_text(PARENT.format(marker=str(marker)))
    here = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, str(script)], cwd=ROOT, env=here) as parent:
        worker = worker_of(marker)
        parent.kill()
    assert ends(worker)


@pytest.mark.slow
def test_what_progress_raises_ends_the_work_at_once(tmp_path: Path) -> None:
    marker = tmp_path / "worker"

    class EnoughError(Exception):
        pass

    def enough(*_: int) -> None:
        if marker.exists():
            raise EnoughError

    with pytest.raises(EnoughError), executor_for(most=1) as executor:
        in_order(executor, says_its_number_and_works, [str(marker)], enough)
    assert ends(int(marker.read_text()))


STOPPED = """
from pathlib import Path
from tests.ident.fitting.test_executors import says_its_number_and_works, worker_of, works_on_much
from lrm_ident.fitting.executors import executor_for, in_order

def enough(*_):
    raise TimeoutError("enough")

if __name__ == "__main__":
    try:
        with executor_for(most=1) as executor:
            executor.submit(says_its_number_and_works, {marker!r})
            worker_of(Path({marker!r}))
            in_order(executor, works_on_much, [({marker!r}, bytes(2_000_000))] * 8, enough)
    except TimeoutError as error:
        print(error)
"""


def works_on_much(item: tuple[str, bytes]) -> None:
    says_its_number_and_works(item[0])


@pytest.mark.slow
def test_a_stopped_work_with_tasks_still_waiting_ends_without_a_trace(tmp_path: Path) -> None:
    """Before: the pool set exceptions of cancelled tasks, printed a traceback, and its process never ended."""
    script = tmp_path / "stopped.py"
    script.write_text(STOPPED.format(marker=str(tmp_path / "worker")))
    here = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, str(script)], cwd=ROOT, env=here, stderr=-1, stdout=-1, text=True) as parent:
        ended = ends(parent.pid)
        out, err = parent.communicate()
    assert (ended, out, err) == (True, "enough\n", "")


@given(st.integers(1, 8), st.integers(1, 40), st.floats(0.1, 1e4))
def test_the_time_of_parts_that_take_alike_is_right_when_a_round_is_done(at_once: int, of: int, each: float) -> None:
    time_of, rounds = TimeOfParts(at_once, 0.0), -(-of // at_once)
    assert time_of.expected(0, of, 5.0) == 5.0
    for number in range(1, rounds + 1):
        done = min(number * at_once, of)
        assert time_of.expected(done, of, number * each) == pytest.approx(rounds * each)
        assert time_of.left(done, of, number * each) == pytest.approx((rounds - number) * each, abs=1e-9 * each)


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


@pytest.mark.long
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
