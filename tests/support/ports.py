"""TCP ports of tests that run side by side."""

from __future__ import annotations

import itertools
import os
import socket

FIRST, COUNT, APART = 20_000, 12_000, 100
"""Below the ports that the kernel gives to connections; processes with neighbouring numbers begin this far apart."""
_next = itertools.count(os.getpid() * APART)


def free_port() -> int:
    """A TCP port on loopback that nobody listens on, and that no other test is given before it is listened on."""
    for number in itertools.islice(_next, COUNT):
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", FIRST + number % COUNT))
            except OSError:
                continue
            return FIRST + number % COUNT
    raise AssertionError(f"no free port of {FIRST} to {FIRST + COUNT}")
