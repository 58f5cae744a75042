"""The serial port, never blocking: bytes in, bytes out, and None as soon as it is gone."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import termios
from array import array

import serial


class Port:
    """A serial port that may come and go. Everything that the system may raise means one thing: closed.

    `error`: the errno of the last attempt to open it, 0 if it succeeded; EAGAIN: another program has the port.
    """

    def __init__(self, path: str, baud: int) -> None:
        self._path, self._baud = path, baud
        self._line: serial.Serial | None = None
        self._torn = False
        self._waiting = array("i", [0])
        self.error = 0

    @property
    def is_open(self) -> bool:
        """Whether the port was open when it was last used."""
        return self._line is not None

    def open(self) -> bool:
        """Tries once, without waiting. A board that resets on DTR is left alone where the driver allows it."""
        if not os.path.exists(self._path):
            self.error = errno.ENOENT
            return False
        try:
            self._line = serial.Serial(self._path, self._baud, timeout=0, write_timeout=0, exclusive=True)
            self.error = 0
        except (OSError, ValueError, termios.error) as error:
            self._line = None
            self.error = getattr(error, "errno", None) or errno.EIO
        self._torn = False
        return self.is_open

    def read(self) -> bytes | None:
        """What has come since the last time, or None if the port is closed.

        Asks first how much there is: a read of an empty terminal waits for the kernel's worker that fills it, and this
        one stands back behind every busy process.
        """
        if self._line is None:
            return None
        try:
            fcntl.ioctl(self._line.fileno(), termios.FIONREAD, self._waiting)
            return os.read(self._line.fileno(), 4096) if self._waiting[0] else b""
        except BlockingIOError:
            return b""
        except OSError:
            self.close()
            return None

    def write(self, data: bytes) -> bool:
        """Sends, or drops what does not fit into the driver's buffer: the next frame says everything again.

        `os.write`, since pyserial spins for ever on a full buffer when it may not wait. After a frame that went out in
        part a 0x00 ends it, so that it costs nothing but itself.
        """
        if self._line is None:
            return False
        out = b"\0" + data if self._torn else data
        try:
            written = os.write(self._line.fileno(), out)
        except BlockingIOError:
            written = 0
        except OSError:
            self.close()
            return False
        self._torn = written < len(out) and (written > 0 or self._torn)
        return written == len(out)

    def close(self) -> None:
        """Closes the port; closing a closed one does nothing."""
        line, self._line = self._line, None
        if line is not None:
            with contextlib.suppress(OSError, termios.error):
                line.close()
