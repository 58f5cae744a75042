"""The C library's heap: memory that a flood of messages took goes back to the system when they are gone."""

from __future__ import annotations

import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # glibc's mallopt(3)
LARGE, ARENAS = 128 * 1024, 2
"""Bytes from which a block is one of its own, and free memory at a heap's end goes back: glibc raises both, up to 32
MB, after the first large message. Heaps that threads share: 8 per processor otherwise, each with gaps of its own."""


def return_freed_memory() -> None:
    """Settings of malloc for a process with many threads that runs for months; to be called before they start.

    Where the C library has no such settings (musl), nothing changes.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for setting, value in ((M_MMAP_THRESHOLD, LARGE), (M_TRIM_THRESHOLD, LARGE), (M_ARENA_MAX, ARENAS)):
            mallopt(setting, value)
