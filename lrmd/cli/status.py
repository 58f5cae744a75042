"""The commands of `lrm` that look at the daemon, or have it take a new model: none of them moves anything."""

from __future__ import annotations

import argparse
import sys
import threading

from lrmd.cli import text
from lrmd.cli.parsing import rover_of
from lrmd.messages.control import Event


def state(o: argparse.Namespace) -> int:
    """`lrm state`."""
    with rover_of(o) as rover:
        pause = threading.Event()
        while True:
            joints, mode = rover.joints(), rover.mode()
            parts = [text.mode_line(mode, joints), text.joints_table(joints, rover.thermal())]
            faults = rover.faults()
            parts += [text.faults_text(faults)] if faults.faults else []
            if o.metrics:
                metrics = rover.metrics()
                parts += [text.metrics_line(metrics), text.lateness_chart(metrics)]
            clear = "\033[H\033[J" if o.watch and sys.stdout.isatty() else ""
            print(clear + "\n".join(parts), flush=True)
            if not o.watch:
                return 0
            pause.wait(0.2)


def info(o: argparse.Namespace) -> int:
    """`lrm info`."""
    with rover_of(o) as rover:
        print(text.info_text(rover.info()))
    return 0


def logs(o: argparse.Namespace) -> int:
    """`lrm logs`."""
    with rover_of(o) as rover:
        for event in rover.events():
            print(text.event_line(event))
        if o.follow:
            rover.watch(Event, "event/**", lambda event: print(text.event_line(event), flush=True))
            threading.Event().wait()
    return 0


def reload(o: argparse.Namespace) -> int:
    """`lrm reload`."""
    with rover_of(o) as rover:
        print(text.model_text((reply := rover.reload()).model, reply.model_sha256))
    return 0
