"""Pseudo-terminal as the serial device of a simulated board, behind a fixed symbolic link."""

from __future__ import annotations

import fcntl
import os
import termios
import tty
from pathlib import Path

from lrm_math.errors import LrmError

LONGEST_READ = 4096


class PtyPort:
    """One device. Between `close` and `open` it does not exist; every `open` creates a new node behind the same link.

    The slave end stays open, else the master reads errors while no host is connected; it is set to raw before it is
    published, else the first bytes would be echoed.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.node = ""
        self._ends: tuple[int, int] | None = None

    def open(self) -> None:
        """Creates the device. Raises `LrmError`."""
        master, slave = os.openpty()
        self._ends = master, slave
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.node = os.ttyname(slave)
        self._publish()

    def _publish(self) -> None:
        temporary = self.link.with_name(f".{self.link.name}.{os.getpid()}")
        try:
            if self.link.exists() and not self.link.is_symlink():
                raise LrmError(f"{self.link}: stands in the way; only an old link is replaced")
            temporary.symlink_to(self.node)
            temporary.replace(self.link)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            raise LrmError(f"{self.link}: cannot be made ({error.strerror})") from None

    @property
    def is_open(self) -> bool:
        """Whether the device exists."""
        return self._ends is not None

    def fileno(self) -> int:
        """The descriptor to poll, -1 while the device does not exist."""
        return self._ends[0] if self._ends else -1

    def read(self) -> bytes:
        """Bytes from the host. Its TIOCEXCL would outlive it on a slave end that stays open: it is taken back."""
        if self._ends is not None:
            fcntl.ioctl(self._ends[1], termios.TIOCNXCL)
        try:
            return os.read(self.fileno(), LONGEST_READ)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Sends to the host; bytes beyond the buffer of a host that does not read are lost."""
        if not (self.is_open and data):
            return
        try:
            os.write(self.fileno(), data)
        except BlockingIOError:
            return

    def close(self) -> None:
        """Removes the device; processes that have it open get a hang-up."""
        if self._ends is None:
            return
        if self.link.is_symlink() and os.readlink(self.link) == self.node:
            self.link.unlink()
        for end in self._ends:
            os.close(end)
        self._ends = None
