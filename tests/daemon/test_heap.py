"""Heaps of a process whose threads are many: few, so that freed memory goes back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lrmd.heap import ARENAS

ROOT = Path(__file__).resolve().parents[2]
COUNT = """
import ctypes, tempfile, threading
from lrmd.heap import return_freed_memory
{settings}
libc, together = ctypes.CDLL(None), threading.Barrier(8)
libc.fopen.restype = libc.malloc.restype = ctypes.c_void_p
def work():
    together.wait(10.0)
    libc.malloc(ctypes.c_size_t(50_000))
    together.wait(10.0)
threads = [threading.Thread(target=work) for _ in range(8)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
with tempfile.NamedTemporaryFile() as file:
    stream = ctypes.c_void_p(libc.fopen(file.name.encode(), b"w"))
    libc.malloc_info(0, stream)
    libc.fclose(stream)
    print(file.read().decode().count("<heap nr="))
"""


def heaps(settings: str) -> int:
    done = subprocess.run(
        [sys.executable, "-c", COUNT.format(settings=settings)], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the daemon runs on Linux")
def test_threads_share_few_heaps() -> None:
    assert heaps("return_freed_memory()") <= ARENAS < heaps("")
