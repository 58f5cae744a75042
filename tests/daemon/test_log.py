"""What a process of the daemon leaves behind: lines of the log in order, few heaps."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from lrmd.heap import ARENAS
from lrmd.log import LINES, BackgroundFile
from tests.support.broken_output import BROKEN_OUTPUTS


def test_lines_come_in_order_and_all_before_the_end() -> None:
    program = (
        "from lrmd.log import BackgroundFile\nfile = BackgroundFile(1)\nfor k in range(900): file.write(f'{k}\\n')"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.split() == [str(k) for k in range(900)]


@pytest.mark.parametrize("output", BROKEN_OUTPUTS)
def test_whoever_does_not_read_holds_nobody_up(output: Callable[[], int]) -> None:
    file = BackgroundFile(output())

    def write_and_close() -> None:
        for _ in range(3 * LINES):
            file.write("a line\n")
        file.close()

    writer = threading.Thread(target=write_and_close, daemon=True)
    writer.start()
    writer.join(60.0)
    assert not writer.is_alive(), "it waits for the reader"


def test_without_a_standard_error_no_other_file_is_written_to(tmp_path: Path) -> None:
    program = (
        "import sys; file = open(sys.argv[1], 'w'); assert file.fileno() == 2\n"
        "from lrmd import log; log.set_up(); import structlog; structlog.get_logger().error('event')"
    )
    shell = ["sh", "-c", 'exec "$0" -c "$1" "$2" 2>&-', sys.executable, program, str(tmp_path / "other")]
    done = subprocess.run(shell, stdout=subprocess.PIPE, text=True, timeout=20)
    assert (done.returncode, done.stdout, (tmp_path / "other").read_text()) == (0, "", "")


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
