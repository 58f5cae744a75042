"""The commands of `lrm` that read the daemon's state or change its model; none of them moves the arm."""

from __future__ import annotations

import argparse
import sys
import threading
from pathlib import Path

from lrm_math.errors import LrmError
from lrmd.cli import text
from lrmd.cli.parsing import open_rover
from lrmd.client.model_text import text_to_deploy
from lrmd.messages.control import Event


def state(o: argparse.Namespace) -> int:
    """`lrm state`: prints the state once, or repeatedly."""
    with open_rover(o) as rover:
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
    """`lrm info`: prints names, limits and rates."""
    with open_rover(o) as rover:
        print(text.info_text(rover.info()))
    return 0


def logs(o: argparse.Namespace) -> int:
    """`lrm logs`: prints the last events, and follows."""
    with open_rover(o) as rover:
        for event in rover.events():
            print(text.event_line(event))
        if o.follow:
            rover.watch(Event, "event/**", lambda event: print(text.event_line(event), flush=True))
            threading.Event().wait()
    return 0


def deploy(o: argparse.Namespace) -> int:
    """`lrm deploy`: gives the daemon a model file, or takes the last one back."""
    if (o.model is None) == (not o.undo):
        raise LrmError("deploy: give a model file, or --undo")
    text_of_file, said = (None, []) if o.model is None else (text_to_deploy(o.model), _checked(o.model, o.accept))
    with open_rover(o) as rover:
        before = rover.info().model_sha256
        reply = rover.undeploy() if text_of_file is None else rover.deploy(text_of_file, o.accept)
        print(text.model_text(reply.model, reply.model_sha256))
        print(f"before: {before[:12] or 'the nominal arm'}; back to it: lrm deploy --undo" if o.model else "undone")
        if reply.tip_moves_m is not None and reply.tip_moves_rms_m is not None:
            most, rms = reply.tip_moves_m * 1e3, reply.tip_moves_rms_m * 1e3
            print(f"at the same commands the tip moves by {rms:.1f} mm RMS, {most:.1f} mm at most")
        for line in said:
            print(line)
        if reply.left_out:
            print(f"not compensated (only explain a measurement): {', '.join(reply.left_out)}")
        if reply.field is not None:
            print(text.field_text(reply.field))
    return 0


def _checked(model: Path, accepted: bool) -> list[str]:
    """Lines on what the daemon leaves out of a model, and on the tip. Raises `LrmError` if that matters."""
    from lrmd.client.deployment import Deployment  # takes a while

    checked = Deployment.of_file(model)
    if not accepted:
        checked.check()
    return list(checked.lines())


def reload(o: argparse.Namespace) -> int:
    """`lrm reload`: reloads the model file."""
    with open_rover(o) as rover:
        reply = rover.reload()
        print(text.model_text(reply.model, reply.model_sha256))
    return 0
