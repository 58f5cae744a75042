"""The commands that a page of the docs tells its reader to type, in order."""

from __future__ import annotations

import re
import shlex
from pathlib import Path


def lines_of(page: Path, program: str = "lrm-ident") -> list[str]:
    """Lines of the page's indented code that begin with the program, without it and without comments."""
    text = re.sub(r" *\\\n +", " ", page.read_text(encoding="utf-8"))
    return [shlex.join(shlex.split(line, comments=True)) for line in re.findall(rf"^    {program} (.*)$", text, re.M)]


def commands_of(page: Path, program: str = "lrm-ident") -> list[list[str]]:
    """The same, as words."""
    return [shlex.split(line) for line in lines_of(page, program)]
