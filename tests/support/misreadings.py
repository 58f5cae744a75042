"""Measurements of the independent generator's arms: read wrongly in every way that is known, and healthy ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.reading_check import ReadingCheck
from lrm_ident.data.source import Source
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.reading import Reading
from validation import synthetic
from validation.synthetic_measurements import measured

ARMS = ("lrm-lab", "so101", "ur5")
ELSEWHERE = {"lrm-lab": "lrm-rover", "so101": "two-joint", "ur5": "lrm-lab"}
"""Another arm whose measurements are taken for the first one's."""
KINDS = (
    *("unit", "radians", "mirrored", "swapped", "turned", "frame", "sign", "order", "arm"),
    *("shuffled angles", "unsigned angles", "constant angles", "shuffled coordinate"),
    *("parallelogram", "differential", "from the base", "Arduino", "pulses", "ratio"),
)
LENGTH_UNITS = {"metres": 1e-3, "inches": 1.0 / 25.4, "micrometres": 1e3}
STIFFNESS = {"ur5": 3e-3}
"""Compliances of the arm over those of a printed one."""
SERVOS, WITHIN_DEG = ("Arduino", "pulses"), 85.0
"""Kinds whose numbers are a hobby servo's, and how far it turns from its middle."""
MOVING = 4
"""Joints, from the base, that move every one of these arms' TCP by more than its errors."""
ANGLE, LENGTH = np.radians(10.0), 0.020
"""Largest errors of healthy data."""
POSES, FEW = 120, (10, 14, 20, 40, 120)
HEALTHY = (*ARMS, "two-joint", "lrm-rover")
AS_STATED = Source(stated=Reading(unit="mm", angle_unit="deg"))


@dataclass(frozen=True, eq=False)
class MisreadCase:
    """Measurements of an arm read wrongly, and words that say how."""

    arm: Arm
    data: Measurements
    truth: str

    def understood(self, check: ReadingCheck | None) -> bool:
        """Whether the check says the truth, alone or as one of several."""
        if check is None or check.right:
            return False
        said = [" and ".join((*scored.hypothesis.words, scored.hypothesis.remedy)) for scored in check.found]
        return not said if not self.truth else any(self.truth in words for words in said)


def random_arm_data(name: str, seed: int, poses: int = POSES, limit_deg: float | None = None) -> Measurements:
    """Measurements of an arm with the errors of a printed one."""
    rig = synthetic.load_arm(shipped_arms()[name])
    truth = of_its_stiffness(name, synthetic.GroundTruth.random(rig, seed))
    return replace(measured(rig, truth, synthetic.random_poses(rig, poses, seed, limit_deg), seed), source=AS_STATED)


def healthy_data(name: str, seed: int) -> Measurements:
    """Measurements of a bad arm: every dimension off by up to 10 deg or 20 mm; few or many poses, loads, outliers."""
    rig, rng = synthetic.load_arm(shipped_arms()[name]), np.random.default_rng([seed, 1])
    places = [f"joint{number + 1}" for number in range(len(rig.links))]
    angles = [f"{place}.{key}_rad" for place in places for key in ("theta", "alpha")]
    angles += [f"base.{key}_rad" for key in ("alpha", "beta", "gamma")]
    lengths = [f"{place}.{key}_m" for place in places for key in ("d", "a")]
    lengths += [f"{place}.{axis}_m" for place in ("base", "tool") for axis in "xyz"]
    off = {key: rng.uniform(-ANGLE, ANGLE) for key in angles} | {key: rng.uniform(-LENGTH, LENGTH) for key in lengths}
    random = of_its_stiffness(name, synthetic.GroundTruth.random(rig, seed))
    truth = replace(
        synthetic.GroundTruth.nominal(rig),
        deviations=synthetic.Deviations.named(len(rig.links), off),
        joint_compliance_rad_per_nm=random.joint_compliance_rad_per_nm,
        effects=(synthetic.SoftPlay(2, np.radians(2.0), 0.02),) if name == "lrm-lab" and seed % 2 else (),
    )
    poses = FEW[seed % len(FEW)]
    data = measured(rig, truth, synthetic.random_poses(rig, poses, seed), seed, load=0.0663 * (seed % 2))
    wrong = rng.random(poses) < 0.05 * (seed % 3)
    return replace(data, source=AS_STATED).with_tcp(data.tcp + wrong[:, None] * rng.normal(0, 0.05, (poses, 3)))


def misread(name: str, kind: str, seed: int) -> MisreadCase:
    """One case: an arm's measurements, read wrongly in one way."""
    rng, arm = np.random.default_rng([seed, KINDS.index(kind)]), load_arm(name)
    if kind == "arm":
        return _of_another_arm(name, seed)
    data = random_arm_data(name, seed, limit_deg=WITHIN_DEG if kind in SERVOS else None)
    changed = dict(_changes(data.poses.q, data.tcp, rng, name))[kind]
    truth, q, tcp = changed
    return MisreadCase(arm, replace(data, poses=replace(data.poses, q=q)).with_tcp(tcp), truth)


def _changes(
    q: Array, tcp: Array, rng: np.random.Generator, name: str
) -> Iterator[tuple[str, tuple[str, Array, Array]]]:
    n = q.shape[1] - (name == "ur5")  # the axis of its last joint goes through the TCP
    unit = str(rng.choice(list(LENGTH_UNITS)))
    yield "unit", (f"look like {unit}", q, tcp * LENGTH_UNITS[unit])
    yield "radians", ("look like radians", np.radians(q), tcp)
    axis, other = rng.choice(3, 2, replace=False).tolist()
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    yield "mirrored", (f"{'xyz'[axis]} looks mirrored", q, tcp * sign)
    swapped = tcp.copy()
    swapped[:, [axis, other]] = tcp[:, [other, axis]]
    first, second = sorted((axis, other))
    yield "swapped", (f"{'xyz'[first]} and {'xyz'[second]} look swapped", q, swapped)
    yield "turned", ("the axes look turned", q, tcp[:, [1, 2, 0]] if rng.integers(2) else -tcp * sign)
    yield "frame", ("another frame", q, tcp @ _random_rotation(rng).T + rng.normal(0.0, 1.0, 3))
    joint, partner = rng.choice(n, 2, replace=False).tolist()
    flipped = q.copy()
    flipped[:, joint] *= -1
    yield "sign", (f"joint {joint + 1} looks counted the other way", flipped, tcp)
    exchanged = q.copy()
    exchanged[:, [joint, partner]] = q[:, [partner, joint]]
    low, high = sorted((joint + 1, partner + 1))
    yield "order", (f"joints {low} and {high} look swapped", exchanged, tcp)
    column = int(rng.integers(MOVING))
    for kind, angles in (
        ("shuffled angles", rng.permutation(q[:, column])),
        ("unsigned angles", -np.abs(q[:, column])),
        ("constant angles", np.ones(len(q))),
    ):
        other_angles = q.copy()
        other_angles[:, column] = angles
        yield kind, (f"the angles of joint {column + 1} do not belong", other_angles, tcp)
    shuffled = tcp.copy()
    shuffled[:, axis] = rng.permutation(tcp[:, axis])
    yield "shuffled coordinate", (f"{'xyz'[axis]} does not belong", q, shuffled)
    before = int(rng.integers(MOVING - 1))
    after, motors = before + 1, q.copy()
    motors[:, after] += q[:, before]
    yield "parallelogram", (f"joint {after + 1} looks counted together with that of joint {before + 1}", motors, tcp)
    motors = q.copy()
    motors[:, [before, after]] = np.stack([q[:, before] - q[:, after], q[:, before] + q[:, after]], axis=1)
    yield "differential", (f"joints {before + 1} and {after + 1} look like those of the two motors", motors, tcp)
    absolute = q.copy()
    absolute[:, 1:MOVING] = np.cumsum(q[:, 1:MOVING], axis=1)
    yield "from the base", (f"joints 3 to {MOVING} look counted from the base", absolute, tcp)
    turned = q * np.where(np.arange(q.shape[1]) == joint, -1.0, 1.0)
    yield "Arduino", ("0 to 180", turned + np.pi / 2.0, tcp)
    yield "pulses", ("pulses of hobby servos", np.radians(1500.0 + np.degrees(turned) / 0.09), tcp)
    slow = q.copy()
    slow[:, column] *= 1.5
    yield "ratio", (f"joint {column + 1} looks to turn 0.667 times", slow, tcp)


def _of_another_arm(name: str, seed: int) -> MisreadCase:
    """Measurements of another arm; if that one has fewer joints, angles are made up for the rest."""
    arm, other = load_arm(name), random_arm_data(ELSEWHERE[name], seed)
    missing = arm.dof - other.poses.q.shape[1]
    made_up = np.random.default_rng(seed).uniform(-1.0, 1.0, (len(other), missing))
    poses = poses_of(np.concatenate([other.poses.q, made_up], axis=1))
    return MisreadCase(arm, replace(other, poses=poses), f"--arm {ELSEWHERE[name]}" if missing == 0 else "")


def _random_rotation(rng: np.random.Generator) -> Array:
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(Q * np.sign(np.linalg.det(Q)))


def of_its_stiffness(name: str, truth: synthetic.GroundTruth) -> synthetic.GroundTruth:
    """The truth of an arm with the compliances of its kind."""
    factor = STIFFNESS.get(name, 1.0)
    return replace(
        truth,
        base_compliance_rad_per_nm=factor * truth.base_compliance_rad_per_nm,
        joint_compliance_rad_per_nm=tuple(factor * k for k in truth.joint_compliance_rad_per_nm),
    )
