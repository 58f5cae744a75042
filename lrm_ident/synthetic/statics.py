"""Elastic equilibrium: torques balanced in the world frame, body by body, and deflections found by Newton's method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .chain import Chain, Posture, hangs_on, move, zero_configuration
from .hidden import EndLoad, JointLoad, Situation
from .rig import Rig
from .screws import Array
from .truth import Truth

TOLERANCE = 1e-13  # of the deflections, rad and m: far below the 1e-9 m to which models are compared
ROUNDS = 120
PATIENCE = 12
SCATTER = 0.02
PROBE = 1e-7


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


def equilibrium(rig: Rig, truth: Truth, now: Situation) -> TrueState:
    """The state in which every deflection is the one its own load causes."""
    chain = _with_wrong_centres(zero_configuration(rig, truth), truth, now)
    bent = tuple(sorted({link for effect in truth.effects for link in effect.bent_links()}))
    weights = _weights(rig, truth, now)

    def settle(u: Array) -> tuple[Posture, _Loads]:
        base, joints, bends = _split(u, len(rig.links), bent)
        posture = move(chain, base, now.q_rad + joints, bends)
        return posture, _loads(chain, truth, now, weights, posture)

    def residual(u: Array) -> Array:
        posture, loads = settle(u)
        return u - _response(truth, now, posture, loads)

    u = newton(residual, np.zeros((len(now.q_rad), 1 + len(rig.links) + 6 * len(bent))))
    posture, loads = settle(u)
    base, joints, _ = _split(u, len(rig.links), bent)
    return TrueState(posture.tcp, loads.tau, loads.base_moment, base, joints, posture)


def _with_wrong_centres(chain: Chain, truth: Truth, now: Situation) -> Chain:
    shifts = sum((effect.added_shifts(now) for effect in truth.effects), np.zeros((1, len(chain.bodies), 3)))
    return chain.with_centres_off(np.asarray(shifts)) if np.any(shifts) else chain


def _split(u: Array, joints: int, bent: tuple[int, ...]) -> tuple[Array, Array, dict[int, Array]]:
    bends = {link: u[:, 1 + joints + 6 * k : 7 + joints + 6 * k] for k, link in enumerate(bent)}
    return u[:, 0], u[:, 1 : 1 + joints], bends


def _weights(rig: Rig, truth: Truth, now: Situation) -> Array:
    """Weight vectors (P, B, 3) in N."""
    masses = np.array([[body.mass_kg for body in rig.bodies]] * len(now.q_rad))
    carries = np.array([body.carries_payload for body in rig.bodies])
    masses[:, carries] += now.payload_kg[:, None]
    for effect in truth.effects:
        masses = masses + effect.added_masses(now)
    return np.asarray(masses[:, :, None] * np.array(rig.gravity_m_per_s2))


def _loads(chain: Chain, truth: Truth, now: Situation, weights: Array, posture: Posture) -> _Loads:
    base_moment = np.zeros(len(weights))
    tau = np.zeros(posture.joint_axes.shape[:2])
    for number, body in enumerate(chain.bodies):
        weight, centre = weights[:, number], posture.centres[:, number]
        moment = np.cross(centre - posture.base_point, weight)
        base_moment += np.sum(posture.base_axis * moment, axis=1)
        for joint in range(body.loads_joint):
            moment = np.cross(centre - posture.joint_points[:, joint], weight)
            tau[:, joint] += np.sum(posture.joint_axes[:, joint] * moment, axis=1)
    gravity = JointLoad(now, posture, tau)
    for effect in truth.effects:
        tau = tau + effect.added_torques(gravity)
    ends = {link: _end_load(chain, now, weights, posture, link) for link in posture.end_axes}
    return _Loads(base_moment, tau, ends)


def _end_load(chain: Chain, now: Situation, weights: Array, posture: Posture, link: int) -> EndLoad:
    force, moment = np.zeros((2, len(weights), 3))
    for number, body in enumerate(chain.bodies):
        if hangs_on(body, link):
            force = force + weights[:, number]
            moment = moment + np.cross(posture.centres[:, number] - posture.end_points[link], weights[:, number])
    axes = posture.end_axes[link]
    return EndLoad(now, link, np.einsum("pji,pj->pi", axes, moment), np.einsum("pji,pj->pi", axes, force))


def _response(truth: Truth, now: Situation, posture: Posture, loads: _Loads) -> Array:
    """The deflections (P, n) that the loads cause."""
    joint_load = JointLoad(now, posture, loads.tau)
    joints = loads.tau * np.array(truth.joint_compliance_rad_per_nm)
    for effect in truth.effects:
        joints = joints + effect.added_angles(joint_load)
    bends = [sum((effect.link_bend(end) for effect in truth.effects), np.zeros(6)) for end in loads.ends.values()]
    return np.hstack([truth.base_compliance_rad_per_nm * loads.base_moment[:, None], joints, *bends])


def newton(residual: Callable[[Array], Array], start: Array) -> Array:
    """Root of P independent systems at once: residual maps (P, n) to (P, n); damped, Jacobian by differences.

    Where gravity pushes a joint off a steep play the residual has a valley without a root; systems that are caught
    there start again from elsewhere, always from the same places.
    """
    rng = np.random.default_rng(0)
    u, r = start, residual(start)
    for number in range(1, ROUNDS + 1):
        unsolved = np.max(np.abs(r), axis=1) >= TOLERANCE
        if not unsolved.any():
            return u
        if number % PATIENCE == 0:
            u = np.where(unsolved[:, None], start + SCATTER * rng.normal(size=u.shape), u)
            r = residual(u)
        step: Array = np.asarray(np.linalg.solve(_jacobian(residual, u, r), r[..., None])[..., 0], dtype=float)
        u, r = _descend(residual, u, r, step)
    raise RuntimeError(f"no equilibrium: {np.max(np.abs(r))} rad left")


def _jacobian(residual: Callable[[Array], Array], u: Array, r: Array) -> Array:
    probes = PROBE * np.eye(u.shape[1])
    return np.stack([(residual(u + probe) - r) / PROBE for probe in probes], axis=-1)


def _descend(residual: Callable[[Array], Array], u: Array, r: Array, step: Array) -> tuple[Array, Array]:
    """Halve the step of those poses that would come out worse."""
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
