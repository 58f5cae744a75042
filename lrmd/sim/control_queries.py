"""Queries to a running simulated board about itself and its arm.

tcp | measure | joints | status      see `answer_query`
payload GRAMS                        sets the payload of the gripper
any fault of lrmd.sim.faults         starts the fault now
"""

from __future__ import annotations

import math
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
        case ["payload", grams]:
            _arm(simulation).set_payload(_grams(grams) * 1e-3)
            return {"payload_g": _arm(simulation).payload * 1e3}
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


def _grams(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise LrmError(f"payload '{word}': should be a number of grams") from None


def _mm(position: Array) -> QueryReply:
    return dict(zip(("x_mm", "y_mm", "z_mm"), (float(p) * 1e3 for p in position), strict=True))


def _conditions(simulation: Simulation, now: int) -> QueryReply:
    arm = _arm(simulation)
    return {"t_s": now / SECOND, "session": arm.session, "payload_g": arm.payload * 1e3, "moving": arm.moving}


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
    arm = (
        {} if simulation.arm is None else {"session": simulation.arm.session, "payload_g": simulation.arm.payload * 1e3}
    )
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
