"""Control socket of a running simulated board: a query (lrmd.sim.control_queries) in, a JSON object out.

A SOCK_SEQPACKET socket at `LINK.ctl`, which also keeps two boards from the same LINK.
"""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

from lrm_math.errors import LrmError
from lrmd.sim.control_queries import QueryReply

LONGEST_MESSAGE = 65_536
TIMEOUT_S = 5.0


class ControlError(LrmError):
    """No simulated board at that link, a second one, or a refused query."""


def control_path(link: Path) -> Path:
    """Path of the control socket of the board at `link`."""
    return link.with_name(link.name + ".ctl")


def query_board(link: Path, question: str) -> QueryReply:
    """Queries the simulated board at `link`, again where it dropped the line before it had the question (as it does
    with a client that a loaded machine keeps waiting). Raises `ControlError`."""
    path, end = control_path(link), time.monotonic() + TIMEOUT_S
    while True:
        try:
            reply = _exchange(path, question)
            break
        except BrokenPipeError as error:
            if time.monotonic() > end:
                raise _no_board(path, error) from None
        except OSError as error:
            raise _no_board(path, error) from None
    if not reply:
        raise ControlError(f"{path}: the simulated board has gone")
    answer: QueryReply = json.loads(reply)
    if "error" in answer:
        raise ControlError(str(answer["error"]))
    return answer


def _exchange(path: Path, question: str) -> bytes:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as line:
        line.settimeout(TIMEOUT_S)
        line.connect(str(path))
        line.send(question.encode())
        return line.recv(LONGEST_MESSAGE)


def _no_board(path: Path, error: OSError) -> ControlError:
    return ControlError(f"{path}: no simulated board answers ({error.strerror or error})")


class ControlServer:
    """The listening socket. Raises `ControlError` if another board already serves this link."""

    def __init__(self, link: Path) -> None:
        self.path = control_path(link)
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._clear()
            self.socket.bind(str(self.path))
            os.chmod(self.path, 0o600)
        except OSError as error:
            self.socket.close()
            raise ControlError(f"{self.path}: cannot be made ({error.strerror or error})") from None
        self.socket.listen()

    def _clear(self) -> None:
        """Removes the socket of a board that was killed."""
        if not self.path.exists():
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
            if probe.connect_ex(str(self.path)) == 0:
                raise ControlError(f"{self.path}: another simulated board is running there; give another --link")
        self.path.unlink()

    def serve(self, reply: Callable[[str], QueryReply]) -> None:
        """Answers one waiting client; a silent one is dropped after 0.1 s."""
        line, _ = self.socket.accept()
        with line:
            line.settimeout(0.1)
            try:
                question = line.recv(LONGEST_MESSAGE).decode(errors="replace")
                line.send(json.dumps(_safe_reply(reply, question)).encode())
            except OSError:
                return

    def close(self) -> None:
        """Closes and removes the socket."""
        self.socket.close()
        self.path.unlink(missing_ok=True)


def _safe_reply(reply: Callable[[str], QueryReply], question: str) -> QueryReply:
    try:
        return reply(question)
    except LrmError as error:
        return {"error": str(error)}
