"""The page's address is told when somebody answers there, not before."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from lrm_ident.workbench import application
from lrm_ident.workbench.address import HOST, LOOK_S, last_session, new_place, note_session
from lrm_ident.workbench.work.tasks import OpenFiles
from tests.support.browser import workbench
from tests.support.commands import part_of_example


def test_waits_for_the_server_to_listen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    place = new_place(None)

    async def run() -> None:
        waiting = asyncio.create_task(place.listening())
        await asyncio.sleep(5 * LOOK_S)
        assert not waiting.done(), "nobody listens yet"
        server = await asyncio.start_server(lambda _, writer: writer.close(), HOST, place.port)
        await waiting
        server.close()

    asyncio.run(asyncio.wait_for(run(), 60.0))


def test_the_last_session_of_the_same_measurements_is_offered(tmp_path: Path) -> None:
    data, other, first = tmp_path / "data.csv", tmp_path / "other.csv", tmp_path / "state" / "1"
    first.mkdir(parents=True)
    files = OpenFiles(first / "step-1.toml", data)
    note_session(first, files)
    for path in (data, other):
        path.touch()
    assert last_session(first.with_name("2"), data) is None, "its model is gone"
    files.model.touch()
    assert last_session(first.with_name("2"), data) == last_session(first.with_name("2"), None) == files
    assert last_session(first.with_name("2"), other) is None, "a session of other measurements"
    assert last_session(first, data) is None, "its own"


@pytest.mark.slow
def test_the_first_request_after_the_address_is_printed_is_answered(tmp_path: Path) -> None:
    with workbench(part_of_example(tmp_path, 60), cwd=tmp_path) as running:
        port = int(running.origin.rsplit(":", 1)[1])
        with socket.create_connection((HOST, port)) as one:
            one.sendall(b"GET / HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n")
            assert one.recv(9) == b"HTTP/1.1 "


def test_the_browsers_command_line_has_no_token(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Every user of the machine reads command lines; the file that stands there only its owner does."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    place, opened = new_place(None), []

    async def listening(_: object) -> None:
        """Takes no time."""

    monkeypatch.setattr(type(place), "listening", listening)
    monkeypatch.setattr(application.webbrowser, "open", opened.append)
    started: list[Callable[[], object]] = []
    monkeypatch.setattr(application.app, "on_startup", started.append)
    session = SimpleNamespace(tick=lambda: None)

    async def run() -> None:
        application._when_started(place, session, show=True)
        started[0]()
        while not opened:
            await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(run(), 60.0))
    (command,) = opened
    assert place.token not in command
    file = Path(command.removeprefix("file://"))
    assert (file.stat().st_mode & 0o777, file.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    assert f"url={place.address}" in file.read_text(encoding="utf-8")
