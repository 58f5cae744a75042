"""Computing that has time: it gives way to the ramp, and to the kernel's workers that carry the board's replies to it.

The bytes of a serial port, a pseudo-terminal's too, pass through a worker of the kernel that has no real-time priority.
Where all processors are busy it waits for one, up to a second; the ramp then has no acknowledgement although the board
gave it in time.
"""

from __future__ import annotations

import os
from contextlib import suppress

NICE = 5
"""Added to the niceness: about a third of the weight of an ordinary process."""


def give_way() -> None:
    """Makes this process and its later threads leave one processor to others, and go after them on the rest.

    Where the system refuses one of the two, or has one processor, that is left out.
    """
    with suppress(OSError):
        os.nice(NICE)
    processors = sorted(os.sched_getaffinity(0))
    with suppress(OSError):
        os.sched_setaffinity(0, processors[1:] or processors)
