"""`lrm record`: the daemon's commands with their times, in a file for `lrm-ident motion`."""

from __future__ import annotations

import argparse
import math
import os
import queue
import time
from pathlib import Path
from typing import TextIO

from lrm_math.errors import LrmError
from lrmd.cli.parsing import open_rover
from lrmd.messages.control import JointsState

SILENT_S = 2.0
"""s without a state after which the daemon is taken as gone."""


def record(o: argparse.Namespace) -> int:
    """`lrm record`: writes commands until Ctrl-C, until the pulses end, or for a time."""
    path = Path(o.output)
    if path.suffix != ".csv":
        raise LrmError(f"-o {path}: should be a name that ends in .csv")
    if o.seconds is not None and not 0.0 < o.seconds < math.inf:
        raise LrmError(f"--seconds {o.seconds:g}: should be more than 0")
    beside = path.with_suffix(".toml")
    for there in filter(Path.exists, (path, beside)):
        raise LrmError(f"{there} is there already; name another file, or remove it")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise LrmError(f"{path}: cannot be written: {path.parent} is no folder, or you may not write there")
    with open_rover(o) as rover:
        info = rover.info()
        if not all(rover.joints().on[: info.joints]):
            raise LrmError("the joints have no pulses; first lrm arm")
        kind = f'schema = "lrm/command-log/1"\narm = "{info.arm}"\ncount_us = {info.count_us:.9g}\n'
        states: queue.SimpleQueue[JointsState] = queue.SimpleQueue()
        rover.watch(JointsState, "state/joints", states.put)
        print("recording; Ctrl-C ends it", flush=True)
        try:
            with path.open("w", encoding="utf-8") as file:
                beside.write_text(kind, encoding="utf-8")
                rows, why = _followed(states, file, info.joints, o.seconds)
        except OSError as error:
            raise LrmError(f"{error.filename or path}: cannot be written ({error.strerror or error})") from None
    print(f"{rows} rows written to {path}; {why}")
    return 0


def _followed(
    states: queue.SimpleQueue[JointsState], file: TextIO, joints: int, seconds: float | None
) -> tuple[int, str]:
    """Rows that were written, and why it ended."""
    file.write(",".join(["t_s", *(f"q{k + 1}_deg" for k in range(joints))]) + "\n")
    rows, last, end = 0, 0, math.inf if seconds is None else time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            try:
                state = states.get(timeout=SILENT_S)
            except queue.Empty:
                return rows, f"no state of the daemon for {SILENT_S:g} s"
            if not all(state.on[:joints]):
                return rows, "the pulses ended"
            if state.t_mono_ns > last:
                last, rows = state.t_mono_ns, rows + 1
                angles = [f"{math.degrees(q):.4f}" for q in state.q_rad[:joints]]
                file.write(",".join([f"{last * 1e-9:.5f}", *angles]) + "\n")
        return rows, f"{seconds:g} s are over"
    except KeyboardInterrupt:
        return rows, "ended by Ctrl-C"
