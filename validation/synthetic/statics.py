"""Elastostatic equilibrium: joint torques of gravity summed body by body, deflections by damped Newton iteration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .arm_description import ArmDescription
from .chain import Posture, TrueChain, forward_kinematics, is_carried_by, zero_configuration
from .ground_truth import GroundTruth
from .hidden_effect import CommandedPoses, EndLoad, JointLoad
from .screws import Array

TOLERANCE = 1e-13  # of the deflections, rad and m: far below the 1e-9 m to which models are compared
MAX_ITERATIONS, RESTART_EVERY = 120, 12
RESTART_SD = 0.02
DIFFERENCE_STEP = 1e-7


@dataclass(frozen=True)
class TrueState:
    """P poses at equilibrium, without noise: tcp_m (P, 3) in world axes; tau_nm (P, N) about the joints and
    base_moment_nm (P,) about the base's y axis before gamma; deflections base_rad (P,) and joints_rad (P, N)."""

    tcp_m: Array
    tau_nm: Array
    base_moment_nm: Array
    base_rad: Array
    joints_rad: Array
    posture: Posture


@dataclass(frozen=True)
class _Loads:
    base_moment: Array
    tau: Array
    ends: dict[int, EndLoad]


def equilibrium(arm: ArmDescription, truth: GroundTruth, poses: CommandedPoses) -> TrueState:
    """The state in which every deflection is the one that its own load causes."""
    chain = zero_configuration(arm, truth)
    if np.any(shifts := sum(effect.added_com_shifts(poses) for effect in truth.effects)):
        shifted = chain.centres[:, None] + np.einsum("bij,pbj->bpi", chain.body_axes, shifts)
        chain = replace(chain, centres=shifted)
    flexible = tuple(sorted({link for effect in truth.effects for link in effect.flexible_links()}))
    weights = _weights(arm, truth, poses)

    def at(u: Array) -> tuple[Posture, _Loads]:
        base, joints, deflections = _split(u, len(arm.links), flexible)
        posture = forward_kinematics(chain, base, poses.q_rad + joints, deflections)
        return posture, _loads(chain, truth, poses, weights, posture)

    start = np.zeros((len(poses.q_rad), 1 + len(arm.links) + 6 * len(flexible)))
    u = newton(lambda u: u - _deflections(truth, poses, at(u)[1]), start)
    posture, loads = at(u)
    base, joints, _ = _split(u, len(arm.links), flexible)
    return TrueState(posture.tcp, loads.tau, loads.base_moment, base, joints, posture)


def _split(u: Array, joints: int, flexible: tuple[int, ...]) -> tuple[Array, Array, dict[int, Array]]:
    deflections = {link: u[:, 1 + joints + 6 * k : 7 + joints + 6 * k] for k, link in enumerate(flexible)}
    return u[:, 0], u[:, 1 : 1 + joints], deflections


def _weights(arm: ArmDescription, truth: GroundTruth, poses: CommandedPoses) -> Array:
    """Weight vectors (P, B, 3) in N."""
    masses = np.array([[body.mass_kg for body in arm.bodies]] * len(poses.q_rad))
    carries = np.array([body.carries_payload for body in arm.bodies])
    masses[:, carries] += poses.payload_kg[:, None]
    for effect in truth.effects:
        masses = masses + effect.added_masses(poses)
    return np.asarray(masses[:, :, None] * np.array(arm.gravity_m_per_s2))


def _loads(chain: TrueChain, truth: GroundTruth, poses: CommandedPoses, weights: Array, posture: Posture) -> _Loads:
    base_moment = np.zeros(len(weights))
    tau = np.zeros(posture.joint_axes.shape[:2])
    for number, body in enumerate(chain.bodies):
        weight, centre = weights[:, number], posture.centres[:, number]
        moment = np.cross(centre - posture.base_point, weight)
        base_moment += np.sum(posture.base_axis * moment, axis=1)
        for joint in range(body.loads_joint):
            moment = np.cross(centre - posture.joint_points[:, joint], weight)
            tau[:, joint] += np.sum(posture.joint_axes[:, joint] * moment, axis=1)
    gravity = JointLoad(poses, tau)
    for effect in truth.effects:
        tau = tau + effect.added_torques(gravity)
    ends = {link: _end_load(chain, poses, weights, posture, link) for link in posture.end_axes}
    return _Loads(base_moment, tau, ends)


def _end_load(chain: TrueChain, poses: CommandedPoses, weights: Array, posture: Posture, link: int) -> EndLoad:
    force, moment = np.zeros((2, len(weights), 3))
    for number, body in enumerate(chain.bodies):
        if is_carried_by(body, link):
            force = force + weights[:, number]
            moment = moment + np.cross(posture.centres[:, number] - posture.end_points[link], weights[:, number])
    axes = posture.end_axes[link]
    return EndLoad(poses, link, np.einsum("pji,pj->pi", axes, moment), np.einsum("pji,pj->pi", axes, force))


def _deflections(truth: GroundTruth, poses: CommandedPoses, loads: _Loads) -> Array:
    """The deflections (P, n) that the loads cause."""
    joint_load = JointLoad(poses, loads.tau)
    joints = loads.tau * np.array(truth.joint_compliance_rad_per_nm)
    for effect in truth.effects:
        joints = joints + effect.added_angles(joint_load)
    ends = [
        sum((effect.link_deflection(end) for effect in truth.effects if link in effect.flexible_links()), np.zeros(6))
        for link, end in loads.ends.items()
    ]
    return np.hstack([truth.base_compliance_rad_per_nm * loads.base_moment[:, None], joints, *ends])


def newton(residual: Callable[[Array], Array], start: Array) -> Array:
    """Roots (P, n) of P independent systems by damped Newton iteration with a finite-difference Jacobian.

    Next to a steep backlash curve |residual| has local minima that are no roots; systems caught in one restart from
    points drawn with a fixed seed. Raises `RuntimeError` if some do not converge.
    """
    rng = np.random.default_rng(0)
    u, r = start, residual(start)
    for number in range(1, MAX_ITERATIONS + 1):
        unsolved = np.max(np.abs(r), axis=1) >= TOLERANCE
        if not unsolved.any():
            return u
        if number % RESTART_EVERY == 0:
            u = np.where(unsolved[:, None], start + RESTART_SD * rng.normal(size=u.shape), u)
            r = residual(u)
        step: Array = np.asarray(np.linalg.solve(_jacobian(residual, u, r), r[..., None])[..., 0], dtype=float)
        u, r = _descend(residual, u, r, step)
    raise RuntimeError(f"no equilibrium: {np.max(np.abs(r))} rad left")


def _jacobian(residual: Callable[[Array], Array], u: Array, r: Array) -> Array:
    steps = DIFFERENCE_STEP * np.eye(u.shape[1])
    return np.stack([(residual(u + step) - r) / DIFFERENCE_STEP for step in steps], axis=-1)


def _descend(residual: Callable[[Array], Array], u: Array, r: Array, step: Array) -> tuple[Array, Array]:
    """Step halving (backtracking) for the systems whose residual would grow."""
    share = np.ones((len(u), 1))
    size = np.linalg.norm(r, axis=1)
    for _ in range(20):
        trial = u - share * step
        left = residual(trial)
        worse = (np.linalg.norm(left, axis=1) >= size) & (size > TOLERANCE)
        if not worse.any():
            break
        share[worse] *= 0.5
    return trial, left
