"""Non-blocking serial port that tolerates being unplugged."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import termios
from array import array

import serial


class SerialPort:
    """A serial port that may come and go: every system error closes it.

    `error`: errno of the last attempt to open it, 0 if it succeeded; EAGAIN, EBUSY: another program has the port.

    pyserial's `exclusive` is a lock that others may leave alone (flock). TIOCEXCL is the kernel's: while the port is
    open, nobody but root opens it.
    """

    def __init__(self, path: str, baud: int) -> None:
        self._path, self._baud = path, baud
        self._line: serial.Serial | None = None
        self._truncated = False
        self._waiting = array("i", [0])
        self.error = 0

    @property
    def is_open(self) -> bool:
        """Whether the port was open at its last use."""
        return self._line is not None

    def open(self) -> bool:
        """Tries once to open the port, without waiting; returns whether it is open."""
        if not os.path.exists(self._path):
            self.error = errno.ENOENT
            return False
        try:
            self._line = serial.Serial(self._path, self._baud, timeout=0, write_timeout=0, exclusive=True)
            fcntl.ioctl(self._line.fileno(), termios.TIOCEXCL)
            self.error = 0
        except (OSError, ValueError, termios.error) as error:
            self._line = None
            self.error = getattr(error, "errno", None) or errno.EIO
        self._truncated = False
        return self.is_open

    def read(self) -> bytes | None:
        """Bytes received since the last call, or None if the port is closed.

        FIONREAD comes first: reading an empty tty waits for the kernel worker that fills it, which has low priority.
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
        """Sends one frame, or drops what exceeds the driver's buffer; returns whether all of it was sent.

        `os.write`, since pyserial spins for ever on a full buffer in non-blocking mode. A truncated frame is ended by a
        0x00 before the next one.
        """
        if self._line is None:
            return False
        out = b"\0" + data if self._truncated else data
        try:
            written = os.write(self._line.fileno(), out)
        except BlockingIOError:
            written = 0
        except OSError:
            self.close()
            return False
        self._truncated = written < len(out) and (written > 0 or self._truncated)
        return written == len(out)

    def close(self) -> None:
        """Closes the port; closing a closed one does nothing."""
        line, self._line = self._line, None
        if line is not None:
            with contextlib.suppress(OSError, termios.error):
                fcntl.ioctl(line.fileno(), termios.TIOCNXCL)  # a pseudo-terminal would keep it
            with contextlib.suppress(OSError, termios.error):
                line.close()
