"""Steps taken in the workbench, as commands of `lrm-ident` that do the same."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lrm_math.model.reading import Reading


@dataclass(frozen=True)
class DoneCommand:
    """A command: its words, and the options of reading and effects that all of them share."""

    words: tuple[str | Path, ...]
    effects_file: Path | None = None
    reading: Reading | None = None

    @property
    def text(self) -> str:
        """Text for a shell."""
        words = ["lrm-ident", *map(str, self.words)]
        if self.effects_file is not None:
            words += ["--effects-file", str(self.effects_file)]
        for name, value in ({} if self.reading is None else self.reading.said()).items():
            text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
            words.append(f"--{name.replace('_', '-')}={text}")
        return shlex.join(words)


def commands_text(done: Sequence[DoneCommand]) -> str:
    """One command a line."""
    return "".join(f"{command.text}\n" for command in done)
