"""Random models and queries for `tests.soak.fuzz_ik`: valid messages, and corruptions of them."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from bench.calibrated_ik import SMOOTH, TABLE_B2, with_effects
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.servo_table import PwmClock
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from lrmd.config import Config
from lrmd.ik.deployed_model import DeployedModel
from lrmd.ik.service import IkService

Content: TypeAlias = dict[str, Any]
REACHABLE = 0.9
"""Share of goals that are reachable; proving that one is not takes much longer."""


def random_model(rng: random.Random) -> Model:
    """The nominal arm, the thesis's, or one with effects of any kind and up to their typical size."""
    thesis, lab = load_model(TABLE_B2), load_arm("lrm-lab")
    kind = rng.randrange(6)
    if kind == 0:
        return model_of(thesis.arm if rng.random() < 0.5 else lab, ())
    if kind == 1:
        return thesis
    known = dict(zip(thesis.keys, thesis.values.tolist(), strict=True))
    on_lab = model_of(lab, effects_at(lab, "offsets") + effects_at(lab, "compliance"), known)
    names = tuple(rng.sample(SMOOTH, rng.randint(1, len(SMOOTH))))
    return with_effects(thesis if rng.random() < 0.5 else on_lab, names, rng.randrange(10**6), rng.uniform(0.0, 0.4))


@dataclass(frozen=True, eq=False)
class ServiceUnderTest:
    """A service with its model, and the clock of its board."""

    service: IkService
    model: Model
    clock: PwmClock


def random_service(rng: random.Random, config: Config) -> ServiceUnderTest:
    """A daemon's service with any model, on a board of any frequency."""
    model, clock = random_model(rng), PwmClock(rng.uniform(50.0, 330.0))
    own = replace(config, arm=model.arm, clock=clock)
    return ServiceUnderTest(IkService.of(own, DeployedModel(model, None, "fuzz", "00" * 32, ())), model, clock)


def random_requests(rng: random.Random, model: Model, count: int) -> list[Content]:
    """Valid messages. The equilibria that make their goals reachable are computed in one batch."""
    contents = [random_request(rng, model) for _ in range(count)]
    owners = [content for content in contents for _ in range(rng.choice([1, 1, 1, 1, 2]))]
    loads = np.array([content["payload_kg"] for content in owners])
    equilibrium, rows = batch_equilibrium(model, Poses(np.array([random_angles(rng, model) for _ in owners]), loads))
    tools: list[Array | None] = [None] * len(owners)
    if len(rows):
        for row, tool in zip(rows.tolist(), frames(model.chain, equilibrium.slots, len(rows))[:, -1], strict=True):
            tools[row] = tool
    for content, tool in zip(owners, tools, strict=True):
        content["goals"].append(random_goal(rng, tool if rng.random() < REACHABLE else None))
    return contents


def random_request(rng: random.Random, model: Model) -> Content:
    """A message without goals yet."""
    payload = rng.choice([0.0, 0.0, 0.0663, rng.uniform(0, 0.2), rng.uniform(0, 2.0)])
    content: Content = {"goals": [], "payload_kg": payload}
    content["method"] = rng.choices(["direct", "cube", "iterative"], [8, 1, 1])[0]
    content["round"] = rng.choice(["each", "best"])
    if content["method"] == "cube" and rng.random() < 0.8:
        content |= {"cube_side_m": 10 ** rng.uniform(-4, -0.7), "cube_points": rng.randint(2, 6)}
    if rng.random() < 0.5:
        content["near_rad"] = random_angles(rng, model, rng.choice([1.0, 1.0, 3.0]))
    return content


def random_angles(rng: random.Random, model: Model, wide: float = 1.0) -> list[float]:
    """Angles all over the limits (times `wide`); now and then at them, or at zero, where axes line up."""
    out = []
    for joint in model.arm.joints:
        kinds = [rng.uniform(joint.lower, joint.upper), joint.lower, joint.upper, 0.0, math.pi / 2]
        out.append(max(-20.0, min(20.0, wide * rng.choices(kinds, [20, 1, 1, 3, 1])[0])))
    return out


def random_goal(rng: random.Random, tool: Array | None) -> Content:
    """A goal at the tool frame (4, 4), or anywhere."""
    turn = rng.choice(["none", "rpy", "quaternion", "approach", "whole"])
    if tool is not None:
        goal: Content = {"position_m": tool[:3, 3].tolist()}
        if turn == "approach":
            goal["approach"] = (tool[:3, 2] * 10 ** rng.uniform(-3, 1)).tolist()
        elif turn != "none":
            R = tool[:3, :3]
            rpy = [math.atan2(R[2, 1], R[2, 2]), -math.asin(max(-1, min(1, R[2, 0]))), math.atan2(R[1, 0], R[0, 0])]
            goal["rpy_rad"] = [float(a) for a in rpy]
        return goal
    size = rng.choice([0.0, 1e-9, 0.1, 0.4, 0.8, 5.0, 100.0])
    goal = {"position_m": [rng.uniform(-size, size) for _ in range(3)]}
    if turn in ("rpy", "whole"):
        goal["rpy_rad"] = [rng.uniform(-7, 7) for _ in range(3)]
    elif turn == "quaternion":
        q = np.array([rng.gauss(0, 1) for _ in range(4)])
        goal["quaternion_xyzw"] = (q / np.linalg.norm(q) * rng.uniform(0.9995, 1.0005)).tolist()
    elif turn == "approach":
        goal["approach"] = [rng.gauss(0, 1) for _ in range(3)]
    return goal


def _millimetres(rng: random.Random, c: Content) -> None:
    c["goals"][0]["position_m"] = [rng.choice([-1, 1]) * rng.uniform(101, 500) for _ in range(3)]


def _degrees(rng: random.Random, c: Content) -> None:
    c["goals"][0] = {"position_m": [0.2, 0.0, 0.3], "rpy_rad": [rng.uniform(21, 180) for _ in range(3)]}


def _grams(rng: random.Random, c: Content) -> None:
    c["payload_kg"] = rng.uniform(3, 500)


def _not_finite(rng: random.Random, c: Content) -> None:
    c["goals"][-1]["position_m"][rng.randrange(3)] = rng.choice([math.nan, math.inf, -math.inf])


def _too_short(rng: random.Random, c: Content) -> None:
    c["goals"][-1]["position_m"] = c["goals"][-1]["position_m"][: rng.randrange(3)]


def _wrong_joints(rng: random.Random, c: Content) -> None:
    c["near_rad"] = [0.1] * rng.choice([1, 2, 5, 7, 16, 17])


def _no_unit_quaternion(rng: random.Random, c: Content) -> None:
    length = rng.choice([0.0, 0.5, 1.01, 50.0])
    c["goals"][0] = {"position_m": [0.2, 0.0, 0.3], "quaternion_xyzw": [0.0, 0.0, 0.0, length]}


def _no_direction(_: random.Random, c: Content) -> None:
    c["goals"][0] = {"position_m": [0.2, 0.0, 0.3], "approach": [0.0, 0.0, 0.0]}


def _twice(_: random.Random, c: Content) -> None:
    c["goals"][0] |= {"rpy_rad": [0.0, 0.0, 0.0], "approach": [0.0, 0.0, 1.0]}


def _unknown(rng: random.Random, c: Content) -> None:
    c[rng.choice(["goal", "position_mm", "near", "\n", ""])] = 1


def _another_type(rng: random.Random, c: Content) -> None:
    name = rng.choice(list(c))
    optional = name in ("near_rad", "payload_kg")
    c[name] = rng.choice([True, {}, "a"] if optional else [True, None, {}, {"a": 1}, b"bytes", [[[]]], "1.0\0"])


def _nothing(_: random.Random, c: Content) -> None:
    c["goals"] = []


CORRUPTIONS: tuple[Callable[[random.Random, Content], None], ...] = (
    _millimetres, _degrees, _grams, _not_finite, _too_short, _wrong_joints, _no_unit_quaternion, _no_direction, _twice,
    _unknown, _another_type, _nothing,
)  # fmt: skip


def damaged(rng: random.Random, data: bytes) -> bytes:
    """The same bytes with some of them changed, left out or put in."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(out) + 1)
        match rng.randrange(3):
            case 0 if at < len(out):
                out[at] = rng.randrange(256)
            case 1:
                del out[at : at + rng.randint(1, 9)]
            case _:
                out[at:at] = rng.randbytes(rng.randint(1, 9))
        out = out or bytearray(1)
    return bytes(out)
