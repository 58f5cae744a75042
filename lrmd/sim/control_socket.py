"""Control socket of a running simulated board: a query about it and its arm in, a JSON object out.

A SOCK_SEQPACKET socket at `LINK.ctl`, which also keeps two boards from the same LINK.

    tcp | measure | joints | status      see `answer_query`
    payload GRAMS [X Y Z]                sets the payload of the gripper and its centre (mm), see `Arm.with_load_at`
    any fault of lrmd.sim.faults         starts the fault now
"""

from __future__ import annotations

import json
import math
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import TypeAlias

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, name_suggestion
from lrmd.link.pca9685 import CHANNELS
from lrmd.sim.arm import SimulatedArm
from lrmd.sim.faults import FAULT_NAMES, parse_fault
from lrmd.sim.simulation import SECOND, Simulation

QueryReply: TypeAlias = dict[str, object]
QUERIES = ("tcp", "measure", "joints", "status", "payload")
LONGEST_MESSAGE = 65_536
TIMEOUT_S = 5.0


def answer_query(simulation: Simulation, question: str, now: int, random: Random, noise: float) -> QueryReply:
    """Answers one query, as the fields of a JSON object; times are s of the board's clock.

    `tcp`: the true TCP; `measure`: a tracker measurement with Gaussian noise of standard deviation `noise` (m) per
    coordinate; `joints`: every servo; `status`: board and chip.

    Raises:
        LrmError: unknown query, no arm on the board, or an arm without equilibrium.
    """
    simulation.tick(now)
    match question.split():
        case ["tcp"]:
            return _conditions(simulation, now) | _mm(_arm(simulation).equilibrium().true_tcp[-1])
        case ["measure"]:
            measured = _arm(simulation).equilibrium().tcp[-1] + [random.gauss(0.0, noise) for _ in range(3)]
            return _conditions(simulation, now) | _mm(measured) | {"sd_mm": noise * 1e3}
        case ["joints"]:
            return _joints(simulation)
        case ["status"]:
            return _status(simulation, now)
        case ["payload", grams, *centre] if len(centre) in (0, 3):
            x, y, z = (_number("payload", "mm", word) * 1e-3 for word in centre or "000")
            _arm(simulation).set_payload(_number("payload", "grams", grams) * 1e-3, (x, y, z))
            return _load(_arm(simulation))
        case [name, *_] if name in FAULT_NAMES:
            planned = parse_fault(question)
            if planned.at:
                raise LrmError(f"'{question}': leave out 'at'; the fault begins now")
            simulation.begin(planned.fault, now)
            return {"begun": question}
    raise LrmError(f"unknown question '{question}'; {name_suggestion(question, (*QUERIES, *FAULT_NAMES))}")


def _arm(simulation: Simulation) -> SimulatedArm:
    if simulation.arm is None:
        raise LrmError("there is no arm behind this board; start it with --arm")
    return simulation.arm


def _number(what: str, unit: str, word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise LrmError(f"{what} '{word}': should be a number of {unit}") from None


def _load(arm: SimulatedArm) -> QueryReply:
    return {"payload_g": arm.payload * 1e3, "payload_centre_mm": [1e3 * component for component in arm.load_at]}


def _mm(position: Array) -> QueryReply:
    return dict(zip(("x_mm", "y_mm", "z_mm"), (float(p) * 1e3 for p in position), strict=True))


def _conditions(simulation: Simulation, now: int) -> QueryReply:
    arm = _arm(simulation)
    return {"t_s": now / SECOND, "session": arm.session, **_load(arm), "moving": arm.moving}


def _joints(simulation: Simulation) -> QueryReply:
    arm = _arm(simulation)
    return {
        servo.name: {
            "angle_deg": math.degrees(servo.angle),
            "target_deg": None if servo.target is None else math.degrees(servo.target),
            "torque_nm": servo.torque,
            "winding_c": arm.temperature(servo),
            "burnt": servo.burnt,
        }
        for servo in arm.servos
    }


def _status(simulation: Simulation, now: int) -> QueryReply:
    board, chip = simulation.board, simulation.board.chip
    pulses = [chip.pulse(channel) for channel in range(CHANNELS)]
    arm = {} if simulation.arm is None else {"session": simulation.arm.session, **_load(simulation.arm)}
    return {
        "t_s": now / SECOND,
        "boot": board.boot,
        "status": [flag.name for flag in board.status],
        "accepted": board.accepted,
        "refused": board.refused,
        "silence_ms": board.silence_ms,
        "pwm_hz": 1.0 / (COUNTS_PER_PERIOD * chip.count_s),
        "pulse_us": [None if pulse is None else pulse * 1e6 for pulse in pulses],
        **arm,
    }


class ControlError(LrmError):
    """No simulated board at that link, a second one, or a refused query."""


def control_path(link: Path) -> Path:
    """Path of the control socket of the board at `link`."""
    return link.with_name(link.name + ".ctl")


def query_board(link: Path, question: str) -> QueryReply:
    """Queries the simulated board at `link`, again where it dropped the line before it had the question (as it does
    with a client that a loaded machine keeps waiting). Raises `ControlError`."""
    path, end = control_path(link), time.monotonic() + TIMEOUT_S
    while True:
        try:
            reply = _exchange(path, question)
            break
        except BrokenPipeError as error:
            if time.monotonic() > end:
                raise _no_board(path, error) from None
        except OSError as error:
            raise _no_board(path, error) from None
    if not reply:
        raise ControlError(f"{path}: the simulated board has gone")
    answer: QueryReply = json.loads(reply)
    if "error" in answer:
        raise ControlError(str(answer["error"]))
    return answer


def _exchange(path: Path, question: str) -> bytes:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as line:
        line.settimeout(TIMEOUT_S)
        line.connect(str(path))
        line.send(question.encode())
        return line.recv(LONGEST_MESSAGE)


def _no_board(path: Path, error: OSError) -> ControlError:
    return ControlError(f"{path}: no simulated board answers ({error.strerror or error})")


class ControlServer:
    """The listening socket. Raises `ControlError` if another board already serves this link."""

    def __init__(self, link: Path) -> None:
        self.path = control_path(link)
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._clear()
            self.socket.bind(str(self.path))
            os.chmod(self.path, 0o600)
        except OSError as error:
            self.socket.close()
            raise ControlError(f"{self.path}: cannot be made ({error.strerror or error})") from None
        self.socket.listen()

    def _clear(self) -> None:
        """Removes the socket of a board that was killed."""
        if not self.path.exists():
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
            if probe.connect_ex(str(self.path)) == 0:
                raise ControlError(f"{self.path}: another simulated board is running there; give another --link")
        self.path.unlink()

    def serve(self, reply: Callable[[str], QueryReply]) -> None:
        """Answers one waiting client; a silent one is dropped after 0.1 s."""
        line, _ = self.socket.accept()
        with line:
            line.settimeout(0.1)
            try:
                question = line.recv(LONGEST_MESSAGE).decode(errors="replace")
                line.send(json.dumps(_safe_reply(reply, question)).encode())
            except OSError:
                return

    def close(self) -> None:
        """Closes and removes the socket."""
        self.socket.close()
        self.path.unlink(missing_ok=True)


def _safe_reply(reply: Callable[[str], QueryReply], question: str) -> QueryReply:
    try:
        return reply(question)
    except LrmError as error:
        return {"error": str(error)}
