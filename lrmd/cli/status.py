"""The commands of `lrm` that read the daemon's state or change its model; none of them moves the arm."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lrm_math.errors import LrmError
from lrm_math.toml_file import schema_of
from lrmd.cli import text
from lrmd.cli.parsing import open_rover
from lrmd.client import RequestRefused
from lrmd.client.model_text import text_to_deploy
from lrmd.messages.control import Event

MOTION_SCHEMA = "lrm/motion/"
"""Beginning of that of a motion model's file; stated here since its schema takes a while to import."""


def state(o: argparse.Namespace) -> int:
    """`lrm state`: prints the state once, or repeatedly."""
    with open_rover(o) as rover:
        pause = threading.Event()
        while True:
            joints, mode = rover.joints(), rover.mode()
            parts = [text.mode_line(mode, joints), text.joints_table(joints, rover.thermal())]
            note, faults = text.pulseless_note(joints), rover.faults()
            parts += [note] if note else []
            parts += [text.faults_text(faults)] if faults.faults else []
            if o.metrics:
                metrics = rover.metrics()
                parts += [text.metrics_line(metrics), text.lateness_chart(metrics)]
            clear = "\033[H\033[J" if o.watch and sys.stdout.isatty() else ""
            print(clear + "\n".join(parts), flush=True)
            if not o.watch:
                return 0
            try:
                pause.wait(0.2)
            except KeyboardInterrupt:
                return 0


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
            with suppress(KeyboardInterrupt):
                threading.Event().wait()
    return 0


def deploy(o: argparse.Namespace) -> int:
    """`lrm deploy`: gives the daemon a model file, of poses or of motion, or takes the last one back."""
    if (o.model is None) == (not o.undo):
        raise LrmError("deploy: give a model file, or --undo")
    if o.undo == "motion" or (o.model is not None and (schema_of(o.model) or "").startswith(MOTION_SCHEMA)):
        return _deploy_motion(o)
    text_of_file, said = (None, []) if o.model is None else (text_to_deploy(o.model), _checked(o.model, o.accept))
    with _naming(o.model), open_rover(o) as rover:
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


def _deploy_motion(o: argparse.Namespace) -> int:
    """Of a model of motion: nothing moves by it, and it counts from the next motion on."""
    text_of_file, said = (None, []) if o.model is None else (text_to_deploy(o.model), _motion_lines(o.model))
    with _naming(o.model), open_rover(o) as rover:
        before = rover.info().motion_sha256
        reply = rover.undeploy("motion") if text_of_file is None else rover.deploy(text_of_file, kind="motion")
        info = rover.info()
    print(text.motion_model_text(reply.motion_model, reply.motion_sha256))
    print(f"before: {before[:12] or 'none'}; back to it: lrm deploy --undo motion" if o.model else "undone")
    for line in (*said, text.shaping_text(info)):
        print(line)
    return 0


@contextmanager
def _naming(model: Path | None) -> Iterator[None]:
    """Names the file before the daemon's words on its text."""
    try:
        yield
    except RequestRefused as error:
        if model is None or error.code != "model":
            raise
        raise LrmError(f"{model}: {error}") from None


def _motion_lines(model: Path) -> list[str]:
    """What a model of motion says of the arm, as far as the daemon uses it. Raises `FileError`: it is none."""
    from lrm_math.motion.effects import Swing  # takes a while
    from lrm_math.motion.motion_model import load_motion

    file, motion_model = load_motion(model)
    swinging = [
        f"{effect.place} {motion_model.values[effect.keys[0]]:.2f} Hz"
        for effect in motion_model.effects
        if isinstance(effect, Swing)
    ]
    lines = [f"swings (at the mean of all postures): {', '.join(swinging) or 'no joint, as far as this model knows'}"]
    last = file.history[-1] if file.history else None
    for error, unit in () if last is None else ((last.held_out_deg, "deg"), (last.held_out_mm, "mm")):
        if error is not None:
            lines.append(f"error of moves that its fit did not use: {error:.2g} {unit} RMS")
    return lines


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
