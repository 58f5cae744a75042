"""Arms of any shape, one to ten joints, some of which may follow others, for laws that hold for all of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm, Body, Joint, MimicJoint, Placement, within_mimics
from lrm_math.kinematics.poses import Poses, poses_of


def random_arm(seed: int, joints: int) -> Arm:
    """An arm of any shape, about as long and heavy as the rover's, bodies in any lawful frame."""
    rng = np.random.default_rng(seed)

    def place() -> Placement:
        return Placement(*rng.normal(0, 0.05, 3).tolist(), *rng.uniform(-math.pi, math.pi, 3).tolist())

    def joint() -> Joint:
        theta, alpha = rng.uniform(-math.pi, math.pi, 2).tolist()
        d, a, extra = rng.uniform(-0.5 / joints, 0.5 / joints, 3).tolist()
        return Joint(theta, d, a, alpha, extra if rng.random() < 0.5 else None, -2.0, 2.0)

    links = tuple(joint() for _ in range(joints))
    bodies = []
    for number in range(1, joints + 1):
        near = links[number - 1].extra_z is not None and bool(rng.random() < 0.5)
        com = tuple(rng.normal(0, 0.03, 3).tolist())
        bodies.append(Body(f"link {number}", float(rng.uniform(0, 0.6 / joints)), com, number, number, near))
    bodies.append(Body("load", 0.05, tuple(rng.normal(0, 0.02, 3).tolist()), joints + 1, joints, False, True))
    return Arm("random", tuple(rng.normal(0, 6, 3).tolist()), place(), links, place(), tuple(bodies))


def with_followers(arm: Arm, seed: int) -> Arm:
    """The same chain, of whose joints about a third have no motor and follow one that has, at any ratio and offset."""
    rng = np.random.default_rng(seed)
    motors = [k for k in range(arm.dof) if rng.random() < 0.65] or [int(rng.integers(arm.dof))]
    mimics = tuple(
        MimicJoint(
            arm.joints[k],
            after=sum(motor < k for motor in motors),
            leader=int(rng.integers(len(motors))),
            ratio=float(rng.choice([-1.0, 1.0, rng.normal()])),
            offset=float(rng.normal(0, 0.3)),
        )
        for k in range(arm.dof)
        if k not in motors
    )
    return replace(arm, joints=within_mimics([arm.joints[k] for k in motors], mimics), mimics=mimics)


free_arms = st.builds(random_arm, st.integers(0, 10_000), st.integers(1, 10))
"""Every joint has a motor."""
arms = free_arms | st.builds(with_followers, free_arms, st.integers(0, 10_000))


def some_poses(arm: Arm, seed: int, count: int = 5) -> Poses:
    """Random ones within 1.7 rad, with and without the usual load."""
    rng = np.random.default_rng(seed)
    return poses_of(rng.uniform(-1.7, 1.7, (count, arm.dof)), rng.choice([0.0, 0.0663], count))
