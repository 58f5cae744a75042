"""The workbench without its page: the process that works, the state, the gate, files that are dropped or grow."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lrm_ident.cli.app import COMMANDS
from lrm_ident.workbench.gate import Gate
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.taken_steps import commands_text
from lrm_ident.workbench.work.session_files import follow_file, keep_dropped, task_for
from lrm_ident.workbench.work.tasks import DiagnoseTask, OpenTask
from lrm_ident.workbench.work.worker import WorkProcess
from lrm_math.errors import FileError, LrmError
from tests.conftest import EXAMPLE
from tests.support.commands import part_of_example, stdout_of

PATIENCE_S = 300.0
TOKEN, PORT = "the-token", 4711


@pytest.fixture
def session(tmp_path: Path) -> Iterator[WorkbenchSession]:
    """A workbench with nothing open."""
    worker = WorkProcess()
    yield WorkbenchSession(tmp_path, worker)
    worker.close()


def until(session: WorkbenchSession, holds: Callable[[], bool]) -> None:
    """Lets the session go on until something holds."""
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end, session.progress
        session.tick()
        time.sleep(0.02)


def diagnosed(session: WorkbenchSession) -> bool:
    return session.step is not None and session.step.report.diagnosis is not None and session.worker.task is None


@pytest.mark.slow
def test_add_and_undo_as_the_commands_do(session: WorkbenchSession, tmp_path: Path) -> None:
    session.open(OpenTask(part_of_example(tmp_path), None))
    until(session, lambda: len(session.taken.steps) == 1 and not session.busy)
    session.add("backlash@joint2")  # while the diagnosis is under way: it waits for it
    with pytest.raises(LrmError, match="still at work"):
        session.undo()
    until(session, lambda: len(session.taken.steps) == 2 and diagnosed(session))
    assert session.step is not None
    first, second = session.step.report.file.history
    assert second.held_out_rms_mm is not None
    assert second.held_out_rms_mm < 0.3 * (first.held_out_rms_mm or 0.0)
    assert "no further systematic error is seen" in session.step.report.verdict
    session.save(tmp_path / "saved.toml")
    for command in commands_text(session.taken.done).splitlines():
        words = command.replace("step-", "again-").split()[1:]
        stdout_of(*words)
    for name in ("step-0.toml", "step-1.toml"):
        ours, theirs = (tomllib.loads((tmp_path / n).read_text()) for n in (name, name.replace("step", "again")))
        assert ours["parameters"] == theirs["parameters"]
        assert ours["history"][-1]["held_out_rms_mm"] == theirs["history"][-1]["held_out_rms_mm"]
    session.undo()
    until(session, lambda: diagnosed(session))
    restored = tomllib.loads(session.taken.steps[-1].files.model.read_text())
    assert restored == tomllib.loads((tmp_path / "step-0.toml").read_text())
    assert not session.can_undo


@pytest.mark.slow
def test_nothing_is_lost_by_a_bad_file_or_when_work_is_cancelled_or_dies(
    session: WorkbenchSession, tmp_path: Path
) -> None:
    session.open(OpenTask(part_of_example(tmp_path), None))
    until(session, lambda: isinstance(session.worker.task, DiagnoseTask))
    session.auto()
    session.cancel()
    assert "cancelled" in session.failure
    assert session.can_diagnose
    session.diagnose()
    os.kill(session.worker._process.pid, signal.SIGKILL)
    until(session, lambda: "ended from outside" in session.failure)
    assert len(session.taken.steps) == 1
    session.diagnose()
    bad = tmp_path / "bad.csv"
    bad.write_text("pose,q1_deg\n1,nonsense\n")
    bad.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\narm = "lrm-lab"\n')
    session.open(OpenTask(bad, None))
    until(session, lambda: "bad.csv" in session.failure)
    until(session, lambda: diagnosed(session))
    assert "bad.csv" in session.failure
    assert len(session.taken.steps) == 1


def test_dropped_files_are_told_apart(tmp_path: Path) -> None:
    model = b'schema = "lrm/model/1"\narm = "lrm-lab"\neffects = []\n'
    contents = {"../x.csv": EXAMPLE.read_bytes(), "x.toml": EXAMPLE.with_suffix(".toml").read_bytes(), "m.toml": model}
    found = keep_dropped(tmp_path, contents)
    assert found == {"data": tmp_path / "x.csv", "model": tmp_path / "m.toml"}
    assert task_for(found, None).model == found["model"]
    with pytest.raises(FileError, match="second file that is model"):
        keep_dropped(tmp_path, {"a.toml": model, "b.toml": model})
    with pytest.raises(FileError, match=r"should be a \.csv"):
        keep_dropped(tmp_path, {"a.exe": b""})
    with pytest.raises(FileError, match="no measurements yet"):
        task_for(keep_dropped(tmp_path, {"m.toml": model}), None)


def test_a_line_that_is_being_written_is_not_read(tmp_path: Path) -> None:
    growing = tmp_path / "growing.csv"
    growing.write_text("pose,q1_deg\n")
    followed = follow_file(growing, tmp_path)
    assert not followed.grown()
    growing.write_text("pose,q1_deg\n1,2.0\n2,3")
    assert followed.grown()
    assert followed.copy.read_text() == "pose,q1_deg\n1,2.0\n"
    assert not followed.grown()


@pytest.mark.parametrize(
    ("headers", "query", "let_in"),
    [
        ({"host": f"127.0.0.1:{PORT}"}, f"token={TOKEN}", True),
        ({"host": f"127.0.0.1:{PORT}", "cookie": f"lrm-workbench-{PORT}={TOKEN}"}, "", True),
        ({"host": f"localhost:{PORT}", "origin": f"http://localhost:{PORT}"}, f"token={TOKEN}", True),
        ({"host": f"127.0.0.1:{PORT}"}, "", False),
        ({"host": f"127.0.0.1:{PORT}"}, "token=wrong", False),
        ({"host": f"127.0.0.1:{PORT}", "cookie": f"lrm-workbench-{PORT}=wrong"}, "", False),
        ({"host": f"127.0.0.1:{PORT}", "origin": "http://evil.example"}, f"token={TOKEN}", False),
        ({"host": f"127.0.0.1:{PORT}", "origin": "null"}, f"token={TOKEN}", False),
        ({"host": "evil.example"}, f"token={TOKEN}", False),
        ({}, f"token={TOKEN}", False),
    ],
)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_the_gate(kind: str, headers: dict[str, str], query: str, let_in: bool) -> None:
    reached, sent = [], list[dict[str, Any]]()

    async def app(scope: Any, *_: Any) -> None:
        reached.append(scope["type"])

    async def receive() -> dict[str, Any]:
        return {"type": f"{kind}.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {
        "type": kind,
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
        "query_string": query.encode(),
    }
    asyncio.run(Gate(app, PORT, TOKEN)(scope, receive, send))
    assert bool(reached) == let_in
    if not let_in:
        assert sent[0].get("status", sent[0].get("code")) in (403, 1008)
        assert b"terminal" in sent[-1].get("body", b"terminal")


@pytest.mark.slow
def test_what_computes_is_not_loaded_before_the_page_is_served() -> None:
    """The page's process would wait for it; the other process loads it meanwhile."""
    code = "import sys, lrm_ident.cli.workbench, lrm_ident.workbench.application; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"scipy", "numpy", "rich", "zenoh"} & set(loaded)


@pytest.mark.slow
def test_no_command_waits_for_scipy_stats() -> None:
    every = ", ".join({f"lrm_ident.cli.{command.module}" for command in COMMANDS.values()})
    code = f"import sys, {every}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "lrm_ident.diagnosis.diagnose" in loaded
    assert "scipy.stats" not in loaded
