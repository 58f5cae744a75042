"""`lrm-ident fleet` with workers and a scheduler that are killed, and a full disk: nothing is lost or done twice."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lrm_ident.data.atomic_write import is_something_else
from lrm_ident.fitting.executors import in_this_process
from tests.support.commands import stderr_of, stdout_of
from tests.support.full_disk import full_disk

WAIT_S, ARMS = 120.0, 3
Command = subprocess.Popen[str]


class Cluster:
    """A Dask scheduler and workers, each a process of its own."""

    def __init__(self, folder: Path, workers: int) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        self.log, self.count = (folder / "cluster.log").open("w"), workers
        self.start()

    def start(self) -> None:
        self.scheduler = self._dask("scheduler", "--port", self.address.rpartition(":")[2], "--host", "127.0.0.1")
        self.workers = [self._dask("worker", self.address, "--nthreads", "1", "--no-nanny") for _ in range(self.count)]

    def end(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _dask(self, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:], "--no-dashboard"]
        return subprocess.Popen(command, stdout=self.log, stderr=self.log)


@pytest.fixture
def few(manifest: Path) -> Path:
    """The manifest's first arms."""
    path = manifest.with_name("few.csv")
    path.write_text("\n".join(manifest.read_text().splitlines()[: ARMS + 1]) + "\n")
    return path


@pytest.fixture
def cluster(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Cluster]:
    """A cluster of as many workers as the test says."""
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    cluster = Cluster(tmp_path, request.param)
    yield cluster
    cluster.end()


def begun(manifest: Path, out: Path, *words: str) -> Command:
    command = [sys.executable, "-m", "lrm_ident", "fleet", str(manifest), "-o", str(out), *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def ended(command: Command) -> tuple[int, str, str]:
    stdout, stderr = command.communicate(timeout=WAIT_S)
    return command.returncode, stdout, stderr


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.02)


def done(out: Path) -> dict[str, int]:
    """When each arm's result was written (ns)."""
    return {path.stem: path.stat().st_mtime_ns for path in (out / "arms").glob("arm*.json")}


def assert_whole(out: Path) -> None:
    """Every arm once, with its model, and nothing else in the folders."""
    for folder, ending in (("arms", "json"), ("models", "toml")):
        assert {path.name for path in (out / folder).iterdir()} == {f"arm{k}.{ending}" for k in range(ARMS)}
    assert all(json.loads(path.read_text())["model"] for path in (out / "arms").iterdir())
    assert not is_something_else(out / "fleet.csv")
    assert len((out / "fleet.csv").read_text().splitlines()) == ARMS + 1


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("cluster", [1], indirect=True)
def test_a_scheduler_that_is_killed_and_started_again(few: Path, tmp_path: Path, cluster: Cluster) -> None:
    """The command ends with one line; started again, it computes what is missing."""
    out = tmp_path / "out"
    first = begun(few, out, "--cluster", cluster.address)
    wait_for(lambda: bool(done(out)))
    cluster.scheduler.send_signal(signal.SIGKILL)
    code, _, stderr = ended(first)
    assert (code, len(stderr.splitlines())) == (2, 1), stderr
    assert "scheduler of the cluster was lost" in stderr
    before = done(out)
    assert len(before) < ARMS
    cluster.end()
    cluster.start()
    code, _, stderr = ended(begun(few, out, "--cluster", cluster.address))
    assert code == 0, stderr
    assert before.items() <= done(out).items()
    assert_whole(out)


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("cluster", [2], indirect=True)
def test_a_worker_that_is_killed_in_the_middle(few: Path, tmp_path: Path, cluster: Cluster) -> None:
    out = tmp_path / "out"
    command = begun(few, out, "--cluster", cluster.address)
    wait_for(lambda: bool(done(out)))
    cluster.workers[0].send_signal(signal.SIGKILL)
    code, _, stderr = ended(command)
    assert code == 0, stderr
    assert_whole(out)


@pytest.mark.slow
def test_a_full_disk(few: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process: no seconds of starting others."""
    monkeypatch.setattr("lrm_ident.cli.groups.fleet.executor_for", lambda *_, **__: in_this_process())
    out = tmp_path / "out"
    with full_disk(out, size=2_000_000, room=100_000) as make_room:
        assert "cannot be written" in stderr_of("fleet", few, "-o", out)
        before = done(out)
        assert len(before) < ARMS
        make_room()
        stdout_of("fleet", few, "-o", out)
        assert before.items() <= done(out).items()
        assert_whole(out)
