"""What a simulated board answers when asked about itself and the arm behind it.

tcp | measure | joints | status      see `answer`
payload GRAMS                        what the gripper carries from now on
any fault of lrmd.sim.faults       begins now
"""

from __future__ import annotations

import math
from random import Random
from typing import TypeAlias

from lrm_math.arm.servo_table import COUNTS_PER_PERIOD
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, nearest
from lrmd.link.pca9685 import CHANNELS
from lrmd.sim.arm import SimulatedArm
from lrmd.sim.faults import FAULT_NAMES, parse_fault
from lrmd.sim.simulation import SECOND, Simulation

Answer: TypeAlias = dict[str, object]
QUESTIONS = ("tcp", "measure", "joints", "status", "payload")


class QuestionError(LrmError):
    """A question that a simulated board cannot answer."""


def answer(simulation: Simulation, question: str, now: int, random: Random, noise: float) -> Answer:
    """One answer. Lengths in mm, angles in deg, pulses in us, s of the board's time.

    `tcp`: where the tool truly is; `measure`: what a tracker would see, with `noise` (m, standard deviation of each
    coordinate) drawn from `random`; `joints`: every servo; `status`: board and chip.

    Raises:
        LrmError: no such question, no arm behind the board, or an arm that does not settle.
    """
    simulation.tick(now)
    match question.split():
        case ["tcp"]:
            return _where(simulation, now) | _mm(_arm(simulation).rest().true_tcp[-1])
        case ["measure"]:
            seen = _arm(simulation).rest().tcp[-1]
            return (
                _where(simulation, now)
                | _mm(seen + [random.gauss(0.0, noise) for _ in range(3)])
                | {"sd_mm": noise * 1e3}
            )
        case ["joints"]:
            return _joints(simulation)
        case ["status"]:
            return _status(simulation, now)
        case ["payload", grams]:
            _arm(simulation).load(_grams(grams) * 1e-3)
            return {"payload_g": _arm(simulation).payload * 1e3}
        case [name, *_] if name in FAULT_NAMES:
            planned = parse_fault(question)
            if planned.at:
                raise QuestionError(f"'{question}': leave out 'at'; the fault begins now")
            simulation.begin(planned.fault, now)
            return {"begun": question}
    names = (*QUESTIONS, *FAULT_NAMES)
    raise QuestionError(f"unknown question '{question}'; {nearest(question, names)}")


def _arm(simulation: Simulation) -> SimulatedArm:
    if simulation.arm is None:
        raise QuestionError("there is no arm behind this board; start it with --arm")
    return simulation.arm


def _grams(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise QuestionError(f"payload '{word}': should be a number of grams") from None


def _mm(position: Array) -> Answer:
    return dict(zip(("x_mm", "y_mm", "z_mm"), (float(p) * 1e3 for p in position), strict=True))


def _where(simulation: Simulation, now: int) -> Answer:
    arm = _arm(simulation)
    return {
        "t_s": now / SECOND,
        "session": arm.session,
        "payload_g": arm.payload * 1e3,
        "moving": arm.moving,
    }


def _joints(simulation: Simulation) -> Answer:
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


def _status(simulation: Simulation, now: int) -> Answer:
    board, chip = simulation.board, simulation.board.chip
    pulses = [chip.pulse(channel) for channel in range(CHANNELS)]
    return {
        "t_s": now / SECOND,
        "boot": board.boot,
        "status": [flag.name for flag in board.status],
        "accepted": board.accepted,
        "refused": board.refused,
        "silence_ms": board.silence_ms,
        "pwm_hz": 1.0 / (COUNTS_PER_PERIOD * chip.count_s),
        "pulse_us": [None if pulse is None else pulse * 1e6 for pulse in pulses],
    }
