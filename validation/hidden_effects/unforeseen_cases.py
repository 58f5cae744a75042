"""The third part of the second catalogue: causes thought of by somebody who had not written the tool.

Their first run, on the version of 26 November, is in docs/results.md; on what was learned from it they say less since.
Joints and links count from 1 (link 0: the base).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from validation.hidden_effects.case_generator import DEG, MM
from validation.hidden_effects.unfamiliar_effects import Half, UnfamiliarCase, hidden, nothing, on
from validation.synthetic import CommandedPoses, EndLoad, HiddenEffect, JointLoad, JointSlip
from validation.synthetic.hidden_effect import at_joint

HALF: Half = "unforeseen"
NEAR = {3: 0.4, 4: -0.3}  # rad


@dataclass(frozen=True)
class DeflectingLink(HiddenEffect):
    """A link (0: the base) whose end turns by a function of the moment on it."""

    link: int

    def flexible_links(self) -> tuple[int, ...]:
        return (self.link,)

    def rotation(self, load: EndLoad) -> Array:
        """Rotation vector (P, 3), rad, in the end frame."""
        raise NotImplementedError

    def link_deflection(self, load: EndLoad) -> Array:
        rotation = self.rotation(load)
        return np.hstack([rotation, np.zeros_like(rotation)])


@dataclass(frozen=True)
class CrackedLink(DeflectingLink):
    """A crack across a link that opens under a positive moment about x, and closes under a negative one."""

    compliance_rad_per_nm: float

    def rotation(self, load: EndLoad) -> Array:
        return np.maximum(load.moment_nm, 0.0) * np.array([self.compliance_rad_per_nm, 0.0, 0.0])


@dataclass(frozen=True)
class LogarithmicCreep(DeflectingLink):
    """Plastic that gives way across the link with the logarithm of time, from its first load on."""

    compliance_rad_per_nm: float
    after_s: float

    def rotation(self, load: EndLoad) -> Array:
        grown = self.compliance_rad_per_nm * np.log1p(load.poses.time_s / self.after_s)
        return grown[:, None] * load.moment_nm * np.array([1.0, 1.0, 0.0])


@dataclass(frozen=True)
class LooseBase(DeflectingLink):
    """Screws of the base with clearance: it leans by tilt_rad about y to the side of the moment."""

    tilt_rad: float

    def rotation(self, load: EndLoad) -> Array:
        return np.sign(load.moment_nm) * np.array([0.0, self.tilt_rad, 0.0])


@dataclass(frozen=True)
class StiffeningTable(DeflectingLink):
    """A table that gives way most under small moments: by the root of the moment (Nm)."""

    turn_rad_per_root_nm: float

    def rotation(self, load: EndLoad) -> Array:
        across = load.moment_nm * np.array([1.0, 1.0, 0.0])
        return self.turn_rad_per_root_nm * np.sign(across) * np.sqrt(np.abs(across))


@dataclass(frozen=True)
class BoucWenFriction(HiddenEffect):
    """Hysteresis of Bouc (1967) and Wen (1976) with smooth transitions over travel_rad."""

    joint: int
    size_rad: float
    travel_rad: float
    steps: int = 40

    def added_angles(self, load: JointLoad) -> Array:
        """The state's solution over each move, by Euler's method."""
        q = load.poses.q_rad[:, self.joint - 1]
        state, now = np.zeros_like(q), 0.0
        for row in range(1, len(q)):
            step = (q[row] - q[row - 1]) / self.steps / self.travel_rad
            for _ in range(self.steps):
                now += step - 0.5 * abs(step) * now - 0.5 * step * abs(now)
            state[row] = now
        return at_joint(self.joint, -self.size_rad * state, load.tau_nm)


@dataclass(frozen=True)
class DeadBand(HiddenEffect):
    """A potentiometer without a reading between two angles: the servo runs on to their middle."""

    joint: int
    middle_rad: float
    half_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        from_middle = load.poses.q_rad[:, self.joint - 1] - self.middle_rad
        return at_joint(self.joint, np.where(np.abs(from_middle) < self.half_rad, -from_middle, 0.0), load.tau_nm)


@dataclass(frozen=True)
class CatchingCable(HiddenEffect):
    """A cable that catches where two other joints stand near some angles, and turns a joint by up to size_rad."""

    joint: int
    where_rad: dict[int, float]
    width_rad: float
    size_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        apart = sum((load.poses.q_rad[:, joint - 1] - angle) ** 2 for joint, angle in self.where_rad.items())
        return at_joint(self.joint, self.size_rad * np.exp(-0.5 * apart / self.width_rad**2), load.tau_nm)


@dataclass(frozen=True)
class SharedSupply(HiddenEffect):
    """A servo that gives way more while another one draws current: by the product of both torques' sizes."""

    joint: int
    other: int
    rad_per_nm2: float

    def added_angles(self, load: JointLoad) -> Array:
        pulled = load.tau_nm[:, self.joint - 1] * np.abs(load.tau_nm[:, self.other - 1])
        return at_joint(self.joint, self.rad_per_nm2 * pulled, load.tau_nm)


@dataclass(frozen=True)
class UnstatedPayload(HiddenEffect):
    """A load that is heavier than stated from the second session on."""

    mass_kg: float

    def added_masses(self, poses: CommandedPoses) -> Array:
        masses = super().added_masses(poses)
        masses[:, -1] = self.mass_kg * (poses.session > poses.session.min())
        return masses


@dataclass(frozen=True)
class OccludedMarker(HiddenEffect):
    """A target of several markers, of which one is hidden on one side of the workspace: its centre moves by size_m."""

    size_m: float

    def measurement_error(self, tcp_m: Array) -> Array:
        hidden = (tcp_m[:, 0] > 0.0) & (tcp_m[:, 1] < -0.02)
        return hidden[:, None] * self.size_m * np.array([0.6, -0.5, 0.62])


@dataclass(frozen=True)
class DistanceDependentNoise(HiddenEffect):
    """A camera whose noise grows with the square of the distance from the arm's axis, up to sd_m per axis."""

    sd_m: float
    seed: int

    def measurement_error(self, tcp_m: Array) -> Array:
        square = (tcp_m[:, :2] ** 2).sum(axis=1)
        noise = np.random.default_rng(self.seed).normal(size=tcp_m.shape)
        return self.sd_m * (square / square.max())[:, None] * noise


def unforeseen() -> tuple[UnfamiliarCase, ...]:
    """Twelve causes with what would be right, two of them on a second arm, and three controls."""
    snag = hidden(HALF, "snag", None, lambda by: CatchingCable(2, NEAR, 0.45, by.sign() * by.size(1.3 * DEG)))
    slip = hidden(
        HALF, "horn-slip", "change_point@joint2", lambda by: JointSlip(2, by.sign() * by.size(0.9 * DEG), 1650.0)
    )
    base = "base_compliance@base"
    return (
        hidden(HALF, "crack", "lateral_compliance@link2", lambda by: CrackedLink(2, by.size(0.10))),
        hidden(HALF, "log-creep", None, lambda by: LogarithmicCreep(2, by.size(0.02), 300.0)),
        on("so101-like", hidden(HALF, "loose-base", base, lambda by: LooseBase(0, by.size(0.6 * DEG)))),
        hidden(HALF, "table", base, lambda by: StiffeningTable(0, by.size(0.01))),
        on(
            "so101-like",
            hidden(HALF, "bouc-wen", "hysteresis@joint2", lambda by: BoucWenFriction(2, by.size(0.9 * DEG), 15 * DEG)),
        ),
        on("so101-like", hidden(HALF, "dead-band", None, lambda by: DeadBand(2, 0.2, by.size(9.0 * DEG)))),
        snag,
        on("ur5-like", snag),
        slip,
        on("ur5-like", slip),
        hidden(HALF, "shared-supply", None, lambda by: SharedSupply(2, 3, by.size(0.12))),
        hidden(HALF, "forgotten-load", None, lambda by: UnstatedPayload(by.size(0.06)), sessions=2),
        hidden(HALF, "hidden-marker", None, lambda by: OccludedMarker(by.size(3.0 * MM))),
        hidden(HALF, "noise-of-distance", None, lambda by: DistanceDependentNoise(by.size(1.2 * MM), 5)),
        nothing(HALF),
        on("so101-like", nothing(HALF)),
        on("ur5-like", nothing(HALF)),
    )
