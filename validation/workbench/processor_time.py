"""Processor time of the workbench until its page is usable, and until the candidates are ranked: `… DATA.csv`.

Counts the page's process and the one that works, not the browser. Linux only.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.support.browser import chromium, idle, opened, workbench

SIZE = {"width": 1366, "height": 768}


def family(pid: int) -> Iterator[int]:
    """A process and all that descend from it."""
    yield pid
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in children.read_text().split():
            yield from family(int(child))


def processor_time(pid: int) -> float:
    """User and system time (s) of a process and all that descend from it, as far as they still run."""
    fields = (Path(f"/proc/{one}/stat").read_text().rsplit(")", 1)[1].split() for one in family(pid))
    return sum(int(one[11]) + int(one[12]) for one in fields) / os.sysconf("SC_CLK_TCK")


def main(data: str) -> None:
    """Prints both times."""
    folder = Path(tempfile.mkdtemp())
    with chromium() as browser, workbench(Path(data).resolve(), cwd=folder) as running:
        page = opened(browser, running, SIZE)
        usable = processor_time(running.process.pid)
        idle(page, "lrm.state.values.ranking.length > 0")
        ranked = processor_time(running.process.pid)
        poses = page.evaluate("lrm.state.values.poses")
        print(f"{poses} poses: usable after {usable:.1f} s of processor time, ranked after {ranked:.1f} s")


if __name__ == "__main__":
    main(sys.argv[1])
