"""Random straight lines of a soft arm's tip, and how far the commanded tip leaves them by the independent generator."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import Goal, pose
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model import Model, model_of
from lrmd.config import Config, load_config
from lrmd.ik.planner import with_corners
from lrmd.ik.straight_line import LineEnd, Waypoint, line_path, rotation_of
from lrmd.ramp.stepping import Pace, move
from tests.conftest import ROOT
from tests.support.daemon.in_memory_daemon import CONFIG
from validation import synthetic

SPRINGS = (0.06, 0.11, 0.08, 0.09, 0.07, 0.05)
"""rad/N m, of the joints."""
EVERY = 25
"""Ticks between two places of the commanded tip that are looked at."""


@dataclass(frozen=True)
class WalkedLine:
    """A line of `length` (m), and the largest deviation (m) of the commanded tip from it.

    `turn`: of a tool that shall keep its direction (rad). `largest_step`: of a pulse in a tick (ns). `ended`: why it
    does not go on to its goal, else empty.
    """

    length: float
    deviation: float = 0.0
    turn: float = 0.0
    largest_step: int = 0
    ended: str = ""


def soft_lab() -> tuple[Config, Model, synthetic.ArmDescription, synthetic.GroundTruth]:
    """The laboratory arm with springs: configured, as a model, and for the generator."""
    arm = load_arm("lrm-lab")
    springs = {f"compliance.joint{i}.k_rad_per_Nm": k for i, k in enumerate(SPRINGS, start=1)}
    model = model_of(arm, effects_at(arm, "compliance"), springs)
    described = synthetic.load_arm(ROOT / "config" / "arms" / "lrm-lab.toml")
    truth = replace(synthetic.GroundTruth.nominal(described), joint_compliance_rad_per_nm=SPRINGS)
    return replace(load_config(CONFIG), arm=arm), model, described, truth


def random_lines(seed: int) -> Iterator[WalkedLine]:
    """Lines of up to 200 mm from random poses, a third of them with a turn of up to 0.5 rad, another with a load."""
    config, model, described, truth = soft_lab()
    solver, rng = CalibratedSolver.of(model), np.random.default_rng(seed)
    while True:
        q, payload = rng.uniform(-1.0, 1.0, 6), float(rng.choice([0.0, 0.0, 0.1]))
        tool = solver.forward(q.tolist(), payload)
        travel = rng.normal(size=3)
        end = np.array(tool.tcp) + travel / np.linalg.norm(travel) * rng.uniform(0.02, 0.2)
        x, y, z = end.tolist()
        goal = Goal((x, y, z))
        if rng.random() < 0.3:
            turn = rng.normal(size=3)
            rotation = np.array(tool.rotation) @ rotation_of(turn / np.linalg.norm(turn) * rng.uniform(0.05, 0.5))
            goal = pose((x, y, z), rotation)
        found = line_path(Waypoint.of(solver, Motion.at(q)), payload, goal, lambda: None)
        length = float(np.linalg.norm(end - np.array(tool.tcp)))
        if isinstance(found, LineEnd):
            yield WalkedLine(length, ended=found.text)
            continue
        commanded, step = ramped(config, with_corners(config, np.array(found)))
        state = synthetic.true_state(described, truth, commanded, payload)
        along = (end - np.array(tool.tcp)) / length
        off = state.tcp_m - np.array(tool.tcp)
        off = off - np.clip(off @ along, 0.0, length)[:, None] * along
        axes = state.posture.joint_axes[:, -1]
        turned = 0.0 if goal.rotation is not None else float(np.linalg.norm(axes - axes[0], axis=1).max())
        yield WalkedLine(length, float(np.linalg.norm(off, axis=1).max()), turned, step)


def ramped(config: Config, path: tuple[tuple[float, ...], ...]) -> tuple[Array, int]:
    """(T, n), angles (rad) that the ramp commands along a path, every `EVERY` ticks; largest step (ns) of a tick."""
    servos = config.servos[: config.dof]
    pulses = [tuple(s.pulse_ns(angle) for s, angle in zip(servos, q, strict=True)) for q in path]
    visited, step = [pulses[0]], 0
    for start, target in pairwise(pulses):
        onward = move(start, target, (config.step,) * len(start), Pace.TOGETHER)
        ticks = [onward.at(k) for k in range(onward.length + 1)]
        step = max([step, *(abs(b - a) for one, other in pairwise(ticks) for a, b in zip(one, other, strict=True))])
        visited += [*ticks[::EVERY], ticks[-1]]
    return np.array([[s.angle(p) for s, p in zip(servos, row, strict=True)] for row in visited]), step
