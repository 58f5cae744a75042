"""`python -m examples.so101.tracker LINK PORT SEED`: an ART tracker beside the simulated SO-101, until that ends.

The tip is seen at rest only; every rest has an error of its own, every frame a further one.
"""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path

import numpy as np

from examples.demo.simulated_tracker import (
    BASE,
    BASE_IN_ROOM,
    FRAME_S,
    FRAME_SD_M,
    REST_SD_M,
    TOOL,
    dtrack_text,
    in_room,
)
from lrm_ident.measuring.tracker.frames import TrackerFrame
from lrm_math.command_line import OneLineParser
from lrm_math.errors import LrmError
from lrmd.sim.control_socket import ControlError, query_board

WAIT_S = 15.0
"""For the arm, which may be started at the same moment."""


def frames(link: Path, seed: int) -> Iterator[TrackerFrame]:
    """One frame after the other. Raises `ControlError` when the bus has gone."""
    rng, rest, tip = np.random.default_rng([seed, 34]), None, np.zeros(3)
    for number in count(1):
        joints = query_board(link, "joints")
        targets = {BASE: BASE_IN_ROOM}
        if not joints["moving"]:
            if joints["goals"] != rest:
                rest = joints["goals"]
                tip = np.array(query_board(link, "tip")["tip_m"]) + rng.normal(scale=REST_SD_M, size=3)
            targets[TOOL] = in_room(tip + rng.normal(scale=FRAME_SD_M, size=3))
        yield TrackerFrame(number, time.monotonic(), targets)


def arm_answers(link: Path, wait_s: float) -> bool:
    """Whether the simulated arm answers at its link within so long."""
    end = time.monotonic() + wait_s
    while True:
        with suppress(ControlError):
            query_board(link, "joints")
            return True
        if time.monotonic() > end:
            return False
        time.sleep(FRAME_S)


def main() -> None:
    """Sends frames. A wrong command line, or no arm, is one line on stderr and exit code 2."""
    usage = "python -m examples.so101.tracker LINK PORT SEED"
    parser = OneLineParser("python -m examples.so101.tracker", usage, "A tracker beside the simulated SO-101.")
    parser.add_argument("link", metavar="LINK", type=Path, help="device of the simulated arm, such as /tmp/so101")
    parser.add_argument("port", metavar="PORT", type=int, help="to which it sends: 5000 for --tracker dtrack:5000")
    parser.add_argument("seed", metavar="SEED", type=int, help="whole number that draws its noise")
    try:
        given = parser.parse_args()
    except LrmError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    link, port, seed = given.link, given.port, given.seed
    if not arm_answers(link, WAIT_S):
        print(
            f"error: {link}: no simulated arm; start it first: python -m examples.so101 {link} play 1", file=sys.stderr
        )
        sys.exit(2)
    print(f"Sends frames to UDP port {port}, for --tracker dtrack:{port}, until the arm ends.", flush=True)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with suppress(ControlError, KeyboardInterrupt):
        for frame in frames(link, seed):
            sender.sendto(dtrack_text(frame), ("127.0.0.1", port))
            time.sleep(FRAME_S)


if __name__ == "__main__":
    main()
