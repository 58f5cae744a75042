"""Place where a workbench runs: a port of this machine, a token, a folder."""

from __future__ import annotations

import asyncio
import secrets
import socket
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.last_error import user_state
from lrm_ident.workbench.work.tasks import OpenFiles, OpenTask
from lrm_math.errors import LrmError

NOTE, NOTED = "session.json", TypeAdapter(OpenFiles)
HOST, LOOK_S = "127.0.0.1", 0.02


def state_folder() -> Path:
    """The workbench's part of what the tool keeps between runs."""
    return user_state() / "workbench"


def new_folder() -> Path:
    """A new folder for the steps of a session, named by the time at which it begins, readable by its owner alone."""
    root = state_folder()
    root.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=time.strftime("%Y-%m-%d-%H%M%S-"), dir=root))


def note_session(folder: Path, files: OpenFiles) -> None:
    """Notes in its folder which files a session has open."""
    write_text(folder / NOTE, NOTED.dump_json(files).decode() + "\n")


def last_session(folder: Path, data: Path | None) -> OpenFiles | None:
    """Files of the newest other session with steps beside a folder, still there; of some measurements, if given."""
    notes = [path for path in folder.parent.glob(f"*/{NOTE}") if path.parent != folder]
    for note in sorted(notes, key=lambda path: path.stat().st_mtime, reverse=True):
        files = _noted(note)
        if files is None or files.model.name == OpenTask.kept.name:
            continue
        if files.model.is_file() and files.data.is_file() and (data is None or _same_data(files.data, data, folder)):
            return files
    return None


def _same_data(noted: Path, data: Path, folder: Path) -> bool:
    """Whether these are the measurements that were noted, or those are a copy of them as they were read once."""
    is_copy = noted.name == data.name and noted.is_relative_to(folder.parent)
    return is_copy or noted.resolve() == data.resolve()


def _noted(note: Path) -> OpenFiles | None:
    """Files that a note names; None of one that was cut off: there is nothing to go on with."""
    try:
        return NOTED.validate_json(note.read_bytes())
    except (OSError, ValueError):
        return None


REDIRECT = "open-workbench.html"


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

    def redirect_file(self) -> Path:
        """A page in the folder that only its owner reads, and that leads a browser to the address.

        A browser is started with what it opens on its command line, which every user of the machine can read.
        """
        path = self.folder / REDIRECT
        write_text(path, f'<!doctype html><meta http-equiv="refresh" content="0; url={self.address}">\n')
        path.chmod(0o600)
        return path

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
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((HOST, port or 0))
        except OSError as error:
            raise LrmError(f"port {port}: cannot be used ({error.strerror}); choose another with --port") from None
        free = int(listener.getsockname()[1])
    return WorkbenchAddress(free, secrets.token_urlsafe(16), new_folder())
