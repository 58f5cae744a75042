"""CSV log of a simulated board: one line per accepted frame, stop on silence and power-on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from lrm_math.errors import FileError
from lrmd.link.pca9685 import CHANNELS

COLUMNS = ("t_ns", "event", "prescale", "silence_ms", *(f"ch{channel}" for channel in range(CHANNELS)))


class FrameLog:
    """A board's listener that writes the log. Cells absent from the frame are empty; a count of 0 is off.

    Line-buffered, so a killed board leaves whole lines. Raises `FileError`.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("w", encoding="utf-8", buffering=1)
        except OSError as error:
            raise FileError(path, "", f"cannot be written ({error.strerror})") from None
        self._file.write(",".join(COLUMNS) + "\n")

    def __call__(self, now: int, event: str, words: Mapping[int, int]) -> None:
        """Writes one line; `words` by bit for `setup`, by channel for `arm`."""
        setup, counts = (words, {}) if event == "setup" else ({}, words)
        cells = [setup.get(bit, "") for bit in range(2)] + [counts.get(channel, "") for channel in range(CHANNELS)]
        self._file.write(f"{now},{event},{','.join(map(str, cells))}\n")

    def close(self) -> None:
        """Closes the file."""
        self._file.close()
