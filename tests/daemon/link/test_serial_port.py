"""The port belongs to whoever has it open: the kernel keeps others out, also those that do not ask for a lock."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from lrmd.link.serial_port import SerialPort

OPENS = """
import os, sys
if os.geteuid() == 0:
    os.setgroups([]); os.setgid(65534); os.setuid(65534)
try:
    os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
except OSError as error:
    sys.exit(error.errno)
"""
"""A program that opens a file as nobody would, and locks nothing."""


def opened_by_another(node: str) -> int:
    """Its errno; 0 if it got in."""
    return subprocess.run([sys.executable, "-c", OPENS, node], check=False).returncode


@pytest.fixture
def node() -> Iterator[str]:
    ends = os.openpty()
    name = os.ttyname(ends[1])
    os.close(ends[1])
    os.chmod(name, 0o666)
    yield name
    os.close(ends[0])


def test_while_it_is_open_nobody_else_opens_it(node: str) -> None:
    assert opened_by_another(node) == 0
    port = SerialPort(node, 115200)
    assert port.open()
    assert opened_by_another(node) == errno.EBUSY
    port.close()
    assert opened_by_another(node) == 0
    assert port.open()
    port.close()
