"""The commit of the code that computes a result."""

from __future__ import annotations

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def _commit() -> str:
    """The commit of the code, with + if it was changed since."""
    try:
        asked = ["git", "describe", "--always", "--abbrev=8", "--dirty=+", "--exclude=*"]
        return subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


COMMIT = _commit()
"""Asked as the program starts: an hour later the tree may be another."""
