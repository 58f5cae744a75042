"""Output in encodings that lack some of the signs that commands print, as those of Windows' pipes and old terminals."""

from __future__ import annotations

import codecs
import io
import sys

PLAIN = {
    "→": "->",
    "≈": "~",
    "≤": "<=",
    "≥": ">=",
    "±": "+-",
    "−": "-",
    "·": "*",
    "…": "...",
    "█": "#",
    "─": "-",
    "°": " deg",
}
"""What stands for a sign that an encoding lacks."""


def print_plainly() -> None:
    """Lets stdout and stderr write `PLAIN`, or ?, for what their encoding lacks, instead of raising."""
    codecs.register_error("plain", _plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # not what a test or a notebook put in its place
            stream.reconfigure(errors="plain")


def _plain(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(sign, "?") for sign in error.object[error.start : error.end]), error.end
