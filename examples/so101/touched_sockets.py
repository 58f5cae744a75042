"""A simulated SO-101 whose tip is jogged into the sockets of a board, and how far a calibration then misses it.

Each is jogged (torque on) until its tip is in a socket: commands are those of 4096 counts a turn, and the tip sits in a
socket within 0.15 mm per axis. Placements and postures are those of `lrm-ident sockets plan`. Errors of the tip are up
to a rigid motion, since neither where a board nor where a tracker stands is known.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from examples.so101.hidden_arm import ARM_FILE, COMPLIANCE_RAD_PER_NM, GEOMETRY_SD
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.similarity import similarity
from lrm_ident.measuring.sockets.board import SocketBoard
from lrm_ident.measuring.sockets.touch_plan import TouchPlan, plan_touches
from lrm_ident.study import api as lrm
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.motion import recorded
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import as_deployed
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation import synthetic
from validation.synthetic import Deviations, GroundTruth, HiddenEffect

ARM = load_arm("so101")
JOINTS = [f"offsets.joint{k}.theta_rad" for k in range(1, ARM.dof + 1)]
LIMITS = np.array([(joint.lower, joint.upper) for joint in ARM.joints]) * 0.99
DEG, COUNT = np.radians(1.0), 2.0 * np.pi / 4096
PLACEMENTS = 3
TOUCHES, FRESH, NOISE_M, MISSED_M = 60, 100, 0.15e-3, 1e-4
HISTORY = 8
Tips = Callable[[Array, int], Array]
"""True tips (P, 3), m, after straight moves along joint angles (P, n), rad, from touch number `first` on."""


def of_generator(*effects: HiddenEffect) -> Callable[[int], Tips]:
    """An arm of the independent generator with random geometry and springs."""

    def drawn(seed: int) -> Tips:
        arm, rng = synthetic.load_arm(ARM_FILE), np.random.default_rng([seed, 65])
        errors = {
            f"joint{k}.{key}": float(rng.normal(scale=sd)) for k in range(1, 6) for key, sd in GEOMETRY_SD.items()
        }
        nominal = GroundTruth.nominal(arm)
        springs = tuple(rng.uniform(*COMPLIANCE_RAD_PER_NM, size=ARM.dof).tolist())
        truth = GroundTruth(Deviations.named(5, errors), nominal.displacements, 0.005, springs, effects)

        def tips(path: Array, first: int) -> Array:
            schedule = synthetic.Schedule(first + np.arange(1.0, len(path) + 1.0), np.ones(len(path)), path[0])
            return np.asarray(synthetic.true_state(arm, truth, path, 0.0, schedule).tcp_m)

        return tips

    return drawn


def joint_step(q: Array, error: Array) -> Array:
    """(n,), rad, change of the joints that moves the tip of the arm as drawn by (3,), m."""
    settled = solve_equilibrium(model_of(ARM, effects_at(ARM, "offsets")), poses_of(q))
    J = parameter_jacobian(settled, JOINTS)[0]
    return np.asarray(np.clip(np.linalg.lstsq(J, error, rcond=0.05)[0], -0.3, 0.3))


@cache
def planned(touches: int, placements: int = PLACEMENTS) -> TouchPlan:
    """The touches that `lrm-ident sockets plan` proposes for an arm as drawn."""
    return plan_touches(ARM, SocketBoard().points, touches, placements, NOISE_M)


def jogged(tips: Tips, path: Array, first: int, goal: Array, begun: Array) -> Array:
    """(n,), rad, the command with which the true tip is in a socket (m) after a path (P, n), jogged from a posture."""
    q = begun
    for _ in range(20):
        tip = tips(np.vstack([path, q]), first)[-1]
        if np.linalg.norm(goal - tip) < 2e-5:
            break
        q = np.clip(q + joint_step(q, goal - tip), *LIMITS.T)
    return q


def touched(tips: Tips, seed: int, touches: int = TOUCHES) -> tuple[Array, list[str], Array, Array]:
    """Commands (N, n), rad, names of the sockets, numbers of the placements, and true tips (N, 3), m.

    A socket into which the tip cannot be jogged from its posture, because a limit is in the way, is left out.
    """
    rng, plan, points = np.random.default_rng([seed, 67]), planned(touches), SocketBoard().points
    motions = [placement.motion(points) for placement in plan.placements]
    path, names, where, seen = np.zeros((0, ARM.dof)), [], [], []
    for begun, name, number in zip(plan.q, plan.points, plan.placement, strict=True):
        goal = (motions[number - 1] @ [*np.array(points[name]) * 1e-3, 1.0])[:3] + rng.normal(0.0, NOISE_M, 3)
        first = max(0, len(path) - HISTORY)
        q = jogged(tips, path[first:], first, goal, begun)
        tip = tips(np.vstack([path[first:], q]), first)[-1]
        if np.linalg.norm(goal - tip) > MISSED_M:
            continue
        path = np.vstack([path, q])
        names.append(name)
        where.append(number)
        seen.append(tip)
    return np.round(path / COUNT) * COUNT, names, np.array(where), np.array(seen)


def loaded(folder: Path, q: Array, columns: dict[str, list[str]], beside: str) -> Measurements:
    """Measurements as the tool reads them from a file."""
    header = ["pose", *(f"q{k}_deg" for k in range(1, ARM.dof + 1)), *columns]
    rows = [[str(n), *(f"{x:.5f}" for x in np.degrees(row)), *(column[n - 1] for column in columns.values())]
            for n, row in enumerate(q, start=1)]  # fmt: skip
    path = folder / "data.csv"
    path.write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")
    path.with_suffix(".toml").write_text(beside)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return lrm.load(path, "so101")


def fresh_poses(rng: np.random.Generator) -> Array:
    """(FRESH, n), rad, of the whole workspace before the arm and above the table."""
    q, drawn = np.zeros((0, ARM.dof)), model_of(ARM, ())
    while len(q) < FRESH:
        one = rng.uniform(*(0.6 * LIMITS.T))
        x, _, z = solve_equilibrium(drawn, poses_of(one)).tcp[0]
        if z > 0.02 and x > 0.08:
            q = np.vstack([q, one])
    return q


def deployed_poses(q: Array) -> Poses:
    """Straight moves along joint angles (N, n), rad, without a load."""
    moves, states = recorded(q, q[0], np.zeros(len(q), dtype=np.bool_))
    return Poses(q, np.zeros(len(q)), direction=moves, number=np.arange(1, len(q) + 1), friction=states)


def tip_error_mm(study: Study, tips: Tips, seed: int) -> float:
    """RMS (mm) at fresh poses, up to a rigid motion."""
    q = fresh_poses(np.random.default_rng([seed, 68]))
    true = tips(q, 1000)
    found = solve_equilibrium(as_deployed(study.model), deployed_poses(q)).tcp
    motion = similarity(found, true, np.ones(len(q)), mirrored=False, scale=1.0)
    return 1e3 * error_stats(motion.apply(found) - true).rms
