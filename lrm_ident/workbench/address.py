"""Place where a workbench runs: a port of this machine, a token, a folder."""

from __future__ import annotations

import asyncio
import secrets
import socket
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.workbench.last_session import new_folder
from lrm_math.errors import LrmError

HOST, LOOK_S = "127.0.0.1", 0.02


@dataclass(frozen=True)
class WorkbenchAddress:
    """Place where a workbench runs: `port` of this machine, `token` of its address, `folder` of its steps."""

    port: int
    token: str
    folder: Path

    @property
    def address(self) -> str:
        """URL that a person opens."""
        return f"http://{HOST}:{self.port}/?token={self.token}"

    async def listening(self) -> None:
        """Waits until the port takes connections."""
        while True:
            try:
                _, writer = await asyncio.open_connection(HOST, self.port)
            except OSError:
                await asyncio.sleep(LOOK_S)
            else:
                writer.close()
                return


def new_place(port: int | None) -> WorkbenchAddress:
    """A free place. Raises `LrmError` if the port is taken."""
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind((HOST, port or 0))
        except OSError as error:
            raise LrmError(f"port {port}: cannot be used ({error.strerror}); choose another with --port") from None
        free = int(one.getsockname()[1])
    return WorkbenchAddress(free, secrets.token_urlsafe(16), new_folder())
