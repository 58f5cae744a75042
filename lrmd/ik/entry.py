"""Entry point of the ik process. What it needs is imported in it, not in the process that starts it."""

from __future__ import annotations

from lrmd.background import give_way
from lrmd.config import Config
from lrmd.ramp.parent import SharedFd


def run(config: Config, memory: SharedFd, boot_id: str) -> None:
    """Answers queries until SIGTERM or until its parent ends."""
    give_way()
    from lrmd.ik import process

    process.run(config, memory, boot_id)
