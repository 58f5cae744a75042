"""Recording of a world that goes on: measured poses, then fresh ones whose true tip is known.

All poses are one sequence, so that what depends on time, order or session goes on: fresh poses are the next ones of the
last session, on the warm arm, after the slip. Their truth has no noise and no error of a tracker. Where a tracker
errs, the truth is given in the frame that it shows: the rigid motion that brings the true measured points nearest to
the points as it saw them. A rover is driven in that frame, since its base was identified in it; scale and shear stay
errors of the tracker and never become truth.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements, load_poses
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.similarity import similarity
from lrm_math.arm.arm_file import load_arm as load_tool_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from validation.hidden_effects.data import NOISE_M
from validation.synthetic import ArmDescription, Dataset, GroundTruth, HiddenEffect, Schedule, true_state, write
from validation.synthetic.generate import rounded

FRESH = 200
GRAVITY_LINE = re.compile(r"^gravity_m_per_s2 = .*$", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class WorldRecording:
    """A recording of `measured` poses, then of fresh ones.

    Attributes:
        arm_file: of the arm as the tool knows it.
        whole: all poses; tcp with the tracker's errors and noise.
        tips_m: (fresh, 3), true tips of the fresh poses in the frame that the tracker shows.
        noise_known: whether the tool is told the noise. loss: of the fit.
    """

    arm_file: Path
    whole: Dataset
    measured: int
    tips_m: Array
    noise_known: bool = True
    loss: str = "squared"

    def load(self, folder: Path, arm_file: Path | None = None) -> tuple[Measurements, Poses]:
        """The measurements as the tool reads them, and the fresh poses as a daemon knows them that was never off."""
        arm = load_tool_arm(arm_file or self.arm_file)
        rows = slice(0, self.measured)
        plan = self.whole.schedule
        part = replace(
            self.whole,
            schedule=Schedule(plan.time_s[rows], plan.session[rows], plan.start_q_rad),
            q_rad=self.whole.q_rad[rows],
            payload_kg=self.whole.payload_kg[rows],
            tcp_m=self.whole.tcp_m[rows],
        )
        source = "synthetic: validation.as_deployed"
        paths = [write(folder / name, data, source)[0] for name, data in (("measured", part), ("whole", self.whole))]
        if not self.noise_known:
            beside = paths[0].with_suffix(".toml")
            lines = beside.read_text(encoding="utf-8").splitlines(keepends=True)
            beside.write_text("".join(line for line in lines if "noise_sd_mm" not in line), encoding="utf-8")
        data = load_measurements(paths[0], arm)
        data = replace(data, source=replace(data.source, arm_name=str(arm_file or self.arm_file)))
        fresh = load_poses(paths[1], arm).take(np.arange(self.measured, len(self.whole.q_rad)))
        return data, fresh

    def arm_with_known_gravity(self, folder: Path) -> Path:
        """The arm file with the true gravity."""
        path, gravity = folder / "arm.toml", [*self.whole.arm.gravity_m_per_s2]
        text = self.arm_file.read_text(encoding="utf-8")
        path.write_text(GRAVITY_LINE.sub(f"gravity_m_per_s2 = {gravity}", text), encoding="utf-8")
        return path


def as_known_to_a_rover(poses: Poses) -> Poses:
    """Poses as a rover knows them after a restart, with angles, loads and moves: no time, session or earlier poses."""
    return Poses(poses.q, poses.payload, poses.direction, friction=poses.friction)


@dataclass(frozen=True)
class OngoingWorld:
    """A world that is measured and goes on.

    Attributes:
        hidden: the truth of a seed, in the tool's words where it has some.
        record: the recording of a seed with so many measured poses.
    """

    hidden: Callable[[int], str]
    record: Callable[[int, int], WorldRecording]

    @classmethod
    def of(cls, hidden: str, record: Callable[[int, int], WorldRecording]) -> OngoingWorld:
        """A world in which the same is hidden with every seed."""
        return cls(lambda _: hidden, record)


@dataclass(frozen=True, eq=False)
class WorldPlan:
    """Commands (P, N) in rad, loads (P,) in kg and times of all poses, of which `measured` are measured."""

    q_rad: Array
    payload_kg: Array
    schedule: Schedule
    measured: int


def recorded(
    arm_file: Path,
    arm: ArmDescription,
    truth: GroundTruth,
    plan: WorldPlan,
    seed: int,
    physical: tuple[type[HiddenEffect], ...] = (),
) -> WorldRecording:
    """The true arm at the poses of a plan. `physical`: errors of measurement that are motions of the tip."""
    q = rounded(plan.q_rad)
    state = true_state(arm, truth, q, plan.payload_kg, plan.schedule).tcp_m
    moved = [effect.measurement_error(state) for effect in truth.effects if isinstance(effect, physical)]
    seen = [effect.measurement_error(state) for effect in truth.effects if not isinstance(effect, physical)]
    true = state + sum(moved, np.zeros(3))
    shown = true + sum(seen, np.zeros(3))
    tcp = shown + NOISE_M * np.random.default_rng(seed).normal(size=true.shape)
    whole = Dataset(arm, truth, plan.schedule, q, plan.payload_kg, tcp, NOISE_M, seed)
    rows = slice(0, plan.measured)
    tips = in_shown_frame(true[rows], shown[rows], true[plan.measured :])
    return WorldRecording(arm_file, whole, plan.measured, tips)


def in_shown_frame(true_m: Array, shown_m: Array, points_m: Array) -> Array:
    """Points (P, 3) moved by the rigid motion that brings true points (N, 3) nearest to shown ones (Kabsch 1976)."""
    if np.array_equal(true_m, shown_m):
        return points_m
    return similarity(true_m, shown_m, np.ones(len(true_m)), mirrored=False, scale=1.0).apply(points_m)
