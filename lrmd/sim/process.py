"""The simulated servo board on a real pty, with an arm behind it."""

from __future__ import annotations

import argparse
import json
import math
import os
import selectors
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from random import Random

from lrm_math.arm.arm_file import load_arm
from lrm_math.command_line import OneLineParser
from lrm_math.errors import FileError, LrmError
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from lrmd.link.pca9685 import CHANNELS
from lrmd.ramp.process import MonotonicClock, request_realtime
from lrmd.sim.arm import SimulatedArm
from lrmd.sim.board import SimulatedBoard
from lrmd.sim.control_socket import ControlServer, QueryReply, answer_query, control_path, query_board
from lrmd.sim.creep import JointCreep
from lrmd.sim.faults import parse_fault
from lrmd.sim.pca9685_chip import Pca9685Chip
from lrmd.sim.pty_port import PtyPort
from lrmd.sim.simulation import SECOND, Simulation
from lrmd.sim.swing import JointSpring

COLUMNS = ("t_ns", "event", "prescale", "silence_ms", *(f"ch{channel}" for channel in range(CHANNELS)))
HELP = """\
faults (--fault, or --ask while it runs; T in seconds of the board's clock):
  flip RATE | flip frame K     one bit arrives wrong
  lose RATE | lose frame K     a frame gets lost
  double RATE | double frame K a frame arrives twice
    ... in | out | both        frames to the board, from it, or both
  stall S                      the line stands still for S s, then all arrives
  hangup S                     the device vanishes for S seconds
  brownout S                   the board loses power for S seconds
  chip S                       the PCA9685 does not answer for S seconds
  chiploss S                   the PCA9685 alone loses power for S seconds
  calm                         no more flips, losses, doubles

questions (--ask): tcp, measure, joints, status, payload GRAMS [X Y Z],
or a fault
"""


class FrameLog:
    """A board's listener that writes a CSV log: one line per accepted frame, stop on silence and power-on.

    Cells absent from the frame are empty; a count of 0 is off.

    Line-buffered, so a killed board leaves whole lines. Raises `FileError`.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("w", encoding="utf-8", buffering=1)
        except OSError as error:
            raise FileError(path, "", f"cannot be written ({error.strerror})") from None
        self._file.write(",".join(COLUMNS) + "\n")

    def __call__(self, now: int, event: str, words: Mapping[int, int]) -> None:
        """Writes one line; `words` by bit for `setup`, by channel for `arm`."""
        setup, counts = (words, {}) if event == "setup" else ({}, words)
        cells = [setup.get(bit, "") for bit in range(2)] + [counts.get(channel, "") for channel in range(CHANNELS)]
        self._file.write(f"{now},{event},{','.join(map(str, cells))}\n")

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def serve(
    simulation: Simulation,
    port: PtyPort,
    control: ControlServer,
    reply: Callable[[str], QueryReply],
    clock: MonotonicClock,
    end: int | None,
) -> None:
    """Event loop until board time `end` (ns; None: for ever) or a `SystemExit` from a signal."""
    waiting = selectors.DefaultSelector()
    waiting.register(control.socket, selectors.EVENT_READ)
    waiting.register(port, selectors.EVENT_READ)
    with waiting:
        while end is None or clock.now() < end:
            port.write(simulation.tick(clock.now()))
            _replug(simulation, port, waiting)
            times = [at for at in (simulation.deadline, end) if at is not None]
            for key, _ in waiting.select(clock.seconds_to(min(times)) if times else None):
                if key.fileobj is control.socket:
                    control.serve(reply)
                else:
                    port.write(simulation.feed(port.read(), clock.now()))


def _replug(simulation: Simulation, port: PtyPort, waiting: selectors.BaseSelector) -> None:
    """Removes or restores the device as the simulation demands."""
    if port.is_open and not simulation.present:
        waiting.unregister(port)
        port.close()
    elif simulation.present and not port.is_open:
        port.open()
        waiting.register(port, selectors.EVENT_READ)


def default_link() -> Path:
    """`lrm-board` in the user's runtime folder, or else in a private folder of the temporary directory."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(runtime) if runtime else Path(tempfile.gettempdir()) / f"lrm-{os.getuid()}"
    if not runtime:
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
        except OSError as error:
            raise LrmError(f"{folder}: cannot be made ({error.strerror}); give --link PATH") from None
        if folder.stat().st_uid != os.getuid():
            raise LrmError(f"{folder}: belongs to somebody else; give --link PATH")
    return folder / "lrm-board"


def channels_of(text: str | None, truth: Model) -> dict[str, int]:
    """`joint1=0,joint2=4,gripper=6` -> channel by servo; None: the joints, then the other servos, from 0 on.

    Raises `LrmError`.
    """
    if text is None:
        names = [*truth.arm.joint_names, *(name for name, _ in truth.arm.auxiliary_servos)]
        return {name: channel for channel, name in enumerate(names)}
    pairs = [pair.partition("=") for pair in text.split(",")]
    for name, _, channel in pairs:
        if not (channel.isdecimal() and int(channel) < 16):
            raise LrmError(f"--channels: '{name}={channel}' should be SERVO=CHANNEL with a channel 0 to 15")
    return {name.strip(): int(channel) for name, _, channel in pairs}


def springs_of(texts: Sequence[str]) -> dict[str, JointSpring]:
    """`joint2=20:0.1` -> spring by joint. Raises `LrmError`."""
    pairs = [text.partition("=") for text in texts]
    return {joint.strip(): JointSpring.parse(spring) for joint, _, spring in pairs}


def creeps_of(texts: Sequence[str]) -> dict[str, JointCreep]:
    """`joint2=0.05:60` -> creep by joint. Raises `LrmError`."""
    pairs = [text.partition("=") for text in texts]
    return {joint.strip(): JointCreep.parse(creep) for joint, _, creep in pairs}


def truth_of(arm: str, truth: Path | None) -> Model:
    """The true model of the arm; the nominal arm by default. Raises `LrmError`."""
    nominal = load_arm(arm)
    if truth is None:
        return model_of(nominal, ())
    model = load_model(truth)
    if model.arm.dof != nominal.dof:
        raise LrmError(f"{truth}: an arm of {model.arm.dof} joints; {arm} has {nominal.dof}")
    return model


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = OneLineParser(
        "lrmd-board", description=__doc__, epilog=HELP, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    number = partial(_number, 0.0, 1e9)
    p.add_argument("--link", type=Path, help="where the device shall stand (default: lrm-board in $XDG_RUNTIME_DIR)")
    p.add_argument("--ask", metavar="QUESTION", help="ask the board that runs at --link, print JSON, and end")
    p.add_argument("--arm", default="lrm-rover", help="shipped arm or arm file (default: %(default)s)")
    p.add_argument("--truth", type=Path, metavar="MODEL", help="model file of what the arm is really like")
    p.add_argument("--channels", metavar="SERVO=N,...", help="default: the joints from channel 0 on, then the others")
    p.add_argument(
        "--start-deg", type=_angles, metavar="Q1,Q2,...", help="where the joints stand at first (default: 0)"
    )
    p.add_argument(
        "--osc-hz", type=partial(_number, 20e6, 30e6), default=25e6, help="the chip's true oscillator (default: 25e6)"
    )
    p.add_argument("--dead-band-us", type=number, help="of every servo (default: 1)")
    p.add_argument(
        "--spring",
        action="append",
        default=[],
        metavar="JOINT=K:D[:F]",
        help="the link swings behind its servo: stiffness (N m/rad), damping (N m s/rad), dry friction (N m)",
    )
    p.add_argument(
        "--creep",
        action="append",
        default=[],
        metavar="JOINT=K:T",
        help="the joint yields slowly under a load: compliance in the long run (rad/(N m)), time constant (s)",
    )
    p.add_argument("--noise-mm", type=number, default=0.3, help="of `measure`, per coordinate (default: %(default)s)")
    p.add_argument("--fault", action="append", default=[], metavar="'FAULT [at T]'", help="may be repeated")
    p.add_argument("--seed", type=int, help="makes boot numbers, faults and noise repeat")
    p.add_argument("--speed", type=partial(_number, 1e-3, 1e4), default=1.0, help="how much faster its clock runs")
    p.add_argument("--seconds", type=number, help="how long it runs, by its own clock")
    p.add_argument("--log", type=Path, metavar="CSV", help="every accepted frame with its time")
    return p


def _number(low: float, high: float, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"'{text}' should be a number from {low:g} to {high:g}")
    return value


def _angles(text: str) -> list[float]:
    return [math.radians(_number(-360.0, 360.0, word)) for word in text.split(",")]


def simulation_of(options: argparse.Namespace) -> Simulation:
    """Board, link and arm from the command line. Raises `LrmError`."""
    truth = truth_of(options.arm, options.truth)
    band = None if options.dead_band_us is None else options.dead_band_us * 1e-6
    channels = channels_of(options.channels, truth)
    springs, creeps = springs_of(options.spring), creeps_of(options.creep)
    arm = SimulatedArm(
        truth, channels, options.start_deg, dead_band=band, speed=options.speed, springs=springs, creeps=creeps
    )
    random = Random(options.seed)
    board = SimulatedBoard(Pca9685Chip(options.osc_hz), random)
    return Simulation(board, arm, random, [parse_fault(text) for text in options.fault])


def run(options: argparse.Namespace) -> None:
    """Runs one board until its time is over or a signal arrives, or queries a running one. Raises `LrmError`."""
    link = options.link or default_link()
    if options.ask is not None:
        print(json.dumps(query_board(link, options.ask)))
        return
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    with ExitStack() as open_things:
        simulation = simulation_of(options)
        control = open_things.enter_context(closing(ControlServer(link)))
        if options.log:
            simulation.board.listener = open_things.enter_context(closing(FrameLog(options.log)))
        port = open_things.enter_context(closing(PtyPort(link)))
        port.open()
        print(f"simulated board at {link} ({port.node}), questions at {control_path(link)}", flush=True)
        clock = MonotonicClock(options.speed, time.monotonic_ns())
        end = None if options.seconds is None else round(options.seconds * SECOND)
        random, noise = Random(options.seed), options.noise_mm * 1e-3

        def reply(question: str) -> QueryReply:
            return answer_query(simulation, question, clock.now(), random, noise)

        request_realtime(1)  # a real board has a processor of its own, whatever else is going on
        serve(simulation, port, control, reply, clock, end)


def main(argv: Sequence[str] | None = None) -> None:
    """Entry point: bad input is one line on stderr and exit code 2."""
    try:
        run(parser().parse_args(argv))
    except LrmError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
