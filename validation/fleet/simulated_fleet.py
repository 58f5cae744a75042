"""Arms of one kind from the independent generator, drawn from a population that the tool does not know.

The kind has errors of its own (a wrong drawing, a way of mounting), the same in all arms; each arm adds its own, which
are smaller. Compliances, play and friction are drawn about the kind's; each effect is there in a part of the arms.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.reference import EffectRef
from lrm_math.kinematics.poses import Poses, poses_of
from validation.synthetic import (
    ArmDescription,
    Deviations,
    FrictionLag,
    GroundTruth,
    HiddenEffect,
    SoftPlay,
    base_displacement_to_deviations,
    load_arm,
    random_poses,
    simulate,
    true_state,
    write,
)
from validation.synthetic.example import ARM_FILE
from validation.synthetic.generate import directions

DEG, NOISE_M, FLOOR_M, LOAD_KG = np.pi / 180.0, 3e-4, 0.1, 0.0663
KIND_ANGLE_SD, KIND_LENGTH_SD, OWN_ANGLE_SD, OWN_LENGTH_SD = 0.02, 0.0015, 0.005, 0.0005
JOINT_COMPLIANCE, BASE_COMPLIANCE, COMPLIANCE_CV = (0.05, 0.12), 0.02, 0.12
BATCHES = ("A", "B")


@dataclass(frozen=True)
class EffectOfKind:
    """An effect that a part (`rate`) of the arms has, its size drawn about `mean` (rad) with `sd`."""

    name: str
    rate: float
    mean: float
    sd: float


EFFECTS = (
    EffectOfKind("backlash@joint2", 0.75, 2.0 * DEG, 0.25 * DEG),
    EffectOfKind("hysteresis@joint3", 0.3, 1.6 * DEG, 0.2 * DEG),
)


@dataclass(frozen=True, eq=False)
class ArmOfKind:
    """One true arm of the kind. `names`: of its effects, in the tool's words. `sizes`: theirs (rad)."""

    number: int
    truth: GroundTruth
    names: tuple[str, ...]
    sizes: tuple[float, ...]
    described: ArmDescription

    @property
    def name(self) -> str:
        """Name in the manifest."""
        return f"arm{self.number:03d}"

    def write_data(self, folder: Path, poses: int) -> Path:
        """Random poses with two loads, measured with noise; the path of the CSV."""
        q = random_poses(self.described, poses, 7919 * self.number + poses, floor_m=FLOOR_M)
        load = np.random.default_rng([self.number, poses]).choice((0.0, LOAD_KG), size=poses)
        data = simulate(self.described, self.truth, q, load, NOISE_M, seed=104729 * self.number + poses)
        return write(folder / self.name, data, "synthetic: validation.fleet")[0]

    def goals(self, count: int = 200) -> tuple[Poses, Array]:
        """Poses that were never measured, and the true tips there (m); the direction of approach is part of a pose."""
        q = random_poses(self.described, count, 15485863 + self.number, floor_m=FLOOR_M)
        poses = replace(poses_of(q, np.zeros(count)), direction=directions(q, np.zeros(q.shape[1])))
        return poses, np.asarray(true_state(self.described, self.truth, q).tcp_m)


def simulated_fleet(count: int, seed: int, own: float = 1.0) -> list[ArmOfKind]:
    """Arms of one kind; `own`: factor of the errors that differ from arm to arm, for makers more or less exact."""
    described = load_arm(ARM_FILE)
    kind = np.random.default_rng([seed, 0])
    joints = len(described.links)
    shape = np.full((joints + 2, 6), 1.0)
    mean = kind.normal(size=shape.shape) * _scaled(shape, KIND_ANGLE_SD, KIND_LENGTH_SD)
    springs = kind.uniform(*JOINT_COMPLIANCE, size=joints)
    arms = []
    for number in range(1, count + 1):
        rng = np.random.default_rng([seed, number])
        errors = mean + rng.normal(size=shape.shape) * _scaled(shape, own * OWN_ANGLE_SD, own * OWN_LENGTH_SD)
        has = [effect for effect in EFFECTS if rng.random() < effect.rate]
        sizes = tuple(round(float(max(rng.normal(effect.mean, effect.sd), effect.mean / 3)), 6) for effect in has)
        truth = GroundTruth(
            Deviations.named(joints, {}),
            tuple(tuple(float(value) for value in np.round(row, 6)) for row in errors),
            round(float(BASE_COMPLIANCE * (1 + COMPLIANCE_CV * rng.normal())), 6),
            tuple(float(v) for v in np.round(springs * (1 + COMPLIANCE_CV * rng.normal(size=joints)), 6)),
            tuple(_hidden(effect.name, size) for effect, size in zip(has, sizes, strict=True)),
        )
        names = tuple(effect.name for effect in has)
        arms.append(ArmOfKind(number, base_displacement_to_deviations(described, truth), names, sizes, described))
    return arms


def write_fleet(arms: Sequence[ArmOfKind], folder: Path, poses: int) -> Path:
    """Measurements of every arm and the manifest; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "manifest.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "arm", "data", "batch"])
        for arm in arms:
            data = arm.write_data(folder, poses)
            writer.writerow([arm.name, "lrm-lab", data.name, BATCHES[arm.number % len(BATCHES)]])
    return path


def _scaled(shape: Array, angle: float, length: float) -> Array:
    spread = shape * length
    spread[:, :3] = shape[:, :3] * angle
    return spread


def _hidden(name: str, size: float) -> HiddenEffect:
    kind, place = EffectRef.parse(name)
    joint = int(place.removeprefix("joint"))
    return SoftPlay(joint, size, 0.04) if kind == "backlash" else FrictionLag(joint, size, 2.0 * DEG)
