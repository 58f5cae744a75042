"""Disks that are full, or have become read-only, for whoever writes to them."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from tests.support.daemon.daemon_process import wait_for


@contextmanager
def full_disk(folder: Path, size: int = 8192, room: int = 0) -> Iterator[Callable[[], None]]:
    """A folder of `size` bytes of which `room` are left; gives what makes room. A tiny file system, or, where that may
    not be mounted, no right to write."""
    folder.mkdir()
    if os.geteuid() != 0:
        folder.chmod(0o500)
        yield lambda: folder.chmod(0o700)
        folder.chmod(0o700)
        return
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], capture_output=True)
    if mounted.returncode:
        pytest.skip("mounting a small file system is not allowed here")
    try:
        filler = folder / "filler"
        with suppress(OSError):
            filler.write_bytes(b"x" * (size - room))
        yield filler.unlink
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """A folder that cannot be written while the block runs: mounted so, or without the right to."""
    if os.geteuid() != 0:
        folder.chmod(0o500)
        yield
        folder.chmod(0o700)
        return
    if subprocess.run(["mount", "--bind", str(folder), str(folder)], capture_output=True).returncode:
        pytest.skip("mounting is not allowed here")
    try:
        remount = ["mount", "-o", "remount,ro,bind", str(folder)]
        wait_for(lambda: not subprocess.run(remount, capture_output=True).returncode, "no file in it is being written")
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)
