"""Hidden effects of joints that depend on time, or on the poses before: friction, creep, warmth, slip. In rad, Nm, s.

*Right* names what leads to the part that is at fault, where the tool has no effect of that kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .generate import rigid_torque
from .hidden_effect import CommandedPoses, HiddenEffect, JointError, JointLoad, past
from .screws import Array


def yielded(drive: Array, time_s: Array, constant_s: float, late: float, fresh: bool) -> Array:
    """(P,), state of a dashpot with time constant constant_s that follows drive (P,).

    The arm leaves for a pose when the share `late` of the time between two readings has passed. Before the first
    reading it had stood there for hours, or, if fresh, hung unloaded.
    """
    state = np.empty_like(drive)
    state[0] = 0.0 if fresh else drive[0]
    for row in range(1, len(drive)):
        pause = time_s[row] - time_s[row - 1]
        left = drive[row - 1] + (state[row - 1] - drive[row - 1]) * np.exp(-late * pause / constant_s)
        state[row] = drive[row] + (left - drive[row]) * np.exp(-(1.0 - late) * pause / constant_s)
    return state


@dataclass(frozen=True)
class FrictionLag(JointError):
    """Friction hysteresis: the joint lags behind its move; reversal is gradual (Dahl 1968, in position, not force).

    width_rad: of the loop; negative if the joint overshoots. travel_rad: the move after which 1 - 1/e of a reversal is
    done. The state from -1 to 1 is drawn by each move towards its direction; a long move precedes the first pose.
    """

    width_rad: float
    travel_rad: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        side = self.direction(poses)
        state = side.copy()
        for row in range(1, len(q)):
            left = np.exp(-abs(q[row] - q[row - 1]) / self.travel_rad)
            state[row] = side[row] + (state[row - 1] - side[row]) * left
        return -0.5 * self.width_rad * state


@dataclass(frozen=True)
class DahlLoop(JointError):
    """Friction with memory (Dahl 1968, exponent 2): the state s obeys ds/dq = (1 - s sign(dq))^2 / travel.

    width_rad: of the loop; travel_rad: the move after which half of a reversal from zero is done.
    """

    width_rad: float
    travel_rad: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        side, state = self.direction(poses), np.zeros_like(q)
        for row in range(1, len(q)):
            gap = 1.0 - state[row - 1] * side[row]
            state[row] = side[row] * (1.0 - gap / (1.0 + gap * abs(q[row] - q[row - 1]) / self.travel_rad))
        return -0.5 * self.width_rad * state


@dataclass(frozen=True)
class BoucWenFriction(JointError):
    """Hysteresis of Bouc (1967) and Wen (1976) with smooth transitions over travel_rad, by Euler's method."""

    size_rad: float
    travel_rad: float
    steps: int = 40

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        state, now = np.zeros_like(q), 0.0
        for row in range(1, len(q)):
            step = (q[row] - q[row - 1]) / self.steps / self.travel_rad
            for _ in range(self.steps):
                now += step - 0.5 * abs(step) * now - 0.5 * step * abs(now)
            state[row] = now
        return -self.size_rad * state


@dataclass(frozen=True)
class StickSlip(JointError):
    """A joint that sticks until wound up by stick_rad, then slips; what stays behind grows with the load.

    slip_rad: what a slip leaves without load; growth_per_nm: the share by which each Nm of torque adds to it.
    """

    stick_rad: float
    slip_rad: float
    growth_per_nm: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        behind, now = np.empty_like(q), -self.slip_rad * self.direction(poses)[0]
        for row, angle in enumerate(q):
            wound = now - (angle - q[row - 1] if row else 0.0)
            now = wound if abs(wound) <= self.stick_rad else float(np.sign(wound)) * self.slip_rad
            behind[row] = now
        return behind * (1.0 + self.growth_per_nm * np.abs(tau))


@dataclass(frozen=True)
class ViscoelasticJoint(JointError):
    """Creep: dashpots beside springs, behind the joint's own spring, all of one compliance: see `yielded`.

    constants_s: of each; polymers have a spectrum of them.
    """

    compliance_rad_per_nm: float
    constants_s: tuple[float, ...]
    late: float = 0.0
    fresh: bool = False

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        states = [yielded(tau, poses.time_s, constant, self.late, self.fresh) for constant in self.constants_s]
        return np.asarray(self.compliance_rad_per_nm * np.mean(states, axis=0))


@dataclass(frozen=True)
class PromptReading(JointError):
    """Creep of a joint that is read after_s after each move, whatever the wait before it."""

    compliance_rad_per_nm: float
    constant_s: float
    after_s: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        state, time = tau.copy(), poses.time_s
        for row in range(1, len(tau)):
            held = max(time[row] - time[row - 1] - self.after_s, 0.0)
            left = tau[row - 1] + (state[row - 1] - tau[row - 1]) * np.exp(-held / self.constant_s)
            state[row] = tau[row] + (left - tau[row]) * np.exp(-self.after_s / self.constant_s)
        return self.compliance_rad_per_nm * state


@dataclass(frozen=True)
class WarmUp(JointError):
    """First-order warm-up drift of a joint towards final_rad; the clock does not restart with a session."""

    final_rad: float
    constant_s: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        return np.asarray(self.final_rad * (1.0 - np.exp2(-poses.time_s / (self.constant_s * np.log(2.0)))))


@dataclass(frozen=True)
class TwoStageWarmUp(JointError):
    """Warm-up of a joint by motor and housing, each with its own time constant; it cools in the breaks of sessions.

    final_rad, constants_s: of motor and housing. A session lasts from its first measurement to its last.
    """

    final_rad: tuple[float, float]
    constants_s: tuple[float, float]

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        time, session = poses.time_s, poses.session
        drift = np.zeros_like(time)
        for final, constant in zip(self.final_rad, self.constants_s, strict=True):
            warmth = 1.0 - np.exp(-time[0] / constant)
            for row in range(len(time)):
                if row:
                    target = 1.0 if session[row] == session[row - 1] else 0.0
                    warmth = target + (warmth - target) * np.exp((time[row - 1] - time[row]) / constant)
                drift[row] += final * warmth
        return drift


@dataclass(frozen=True)
class FanCycles(JointError):
    """A fan that goes on and off: a joint warms and cools by turns. Right: drift of the joint."""

    size_rad: float
    period_s: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        part = poses.time_s / self.period_s % 1.0
        since = np.exp(-4.0 * (part % 0.5)) / (1.0 + np.exp(-2.0))
        return np.asarray(self.size_rad * np.where(part < 0.5, 1.0 - since, since))


@dataclass(frozen=True)
class HeatedServo(JointError):
    """A servo whose zero and scale move with its own temperature, which losses of the holding current (τ²) make."""

    zero_rad_per_nm2: float
    scale_per_nm2: float
    constant_s: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        heat = yielded(tau**2, poses.time_s, self.constant_s, 0.0, True)
        return (self.zero_rad_per_nm2 + self.scale_per_nm2 * q) * heat


@dataclass(frozen=True)
class SofteningByHeat(JointError):
    """A gear of plastic that its own servo heats by the square of the torque, and that gives way more when hot.

    Right: nonlinear_stiffness (it gives way more after large torques) or drift (it warms up) of the joint.
    """

    compliance_rad_per_nm: float
    settling_s: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        power = rigid_torque(poses, self.joint) ** 2
        heat = yielded(power, poses.time_s, self.settling_s, late=1.0, fresh=True)
        return np.asarray(self.compliance_rad_per_nm * (heat / power.mean()) * tau)


@dataclass(frozen=True)
class EmptyingBattery(HiddenEffect):
    """A battery that runs down: all servos hold their angles less and less stiffly. No name says so."""

    compliance_rad_per_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        time = load.poses.time_s
        return np.asarray(self.compliance_rad_per_nm * (time / time.max())[:, None] * load.tau_nm)


@dataclass(frozen=True)
class OverloadProtection(JointError):
    """A bus servo that weakens itself once it has held a large torque in two poses running.

    Right: nonlinear_stiffness, as the joint gives way more under a large torque.
    """

    limit_nm: float
    compliance_rad_per_nm: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        before = np.append(0.0, np.abs(rigid_torque(poses, self.joint))[:-1]) > self.limit_nm
        large = 0.5 + 0.5 * np.tanh((np.abs(tau) - self.limit_nm) / (0.25 * self.limit_nm))
        return self.compliance_rad_per_nm * tau * large * before


@dataclass(frozen=True)
class JointSlip(JointError):
    """A joint that stands elsewhere from one moment on: a belt that skips a tooth, a horn that slips."""

    size_rad: float
    since_s: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        return np.where(poses.time_s >= self.since_s, self.size_rad, 0.0)


@dataclass(frozen=True)
class SessionStep(JointError):
    """Zero offset of a joint that changes at power-on: one angle per session."""

    steps_rad: tuple[float, ...]

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        return np.asarray(np.array(self.steps_rad)[poses.session.astype(int) - 1])


@dataclass(frozen=True)
class SlippingClutch(JointError):
    """A servo saver that slips by and by under large torques, and stays where it slipped to.

    Right: change_point (what slips stands elsewhere later), or slip, which the tool has since: a zero that steps
    towards the joint's load, the further the larger it is, and stays. A drift would say that it warms up.
    """

    limit_nm: float
    slip_rad_per_nm: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        rigid = rigid_torque(poses, self.joint)
        return self.slip_rad_per_nm * past(np.sign(rigid) * np.maximum(np.abs(rigid) - self.limit_nm, 0.0))


@dataclass(frozen=True)
class SlippingHorn(JointError):
    """A horn that slips on its shaft at each reversal, towards where the load pulls it, until its screw stops it.

    A slip goes a share of the way that is left to the bound, larger under more load.
    """

    bound_rad: float
    share_per_nm: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        side, place, slipped = self.direction(poses), 0.0, np.zeros(len(tau))
        for row in range(len(tau)):
            if row and side[row] * side[row - 1] < 0.0:
                way = self.bound_rad * np.sign(tau[row]) - place
                place += way * (1.0 - np.exp(-self.share_per_nm * abs(tau[row])))
            slipped[row] = place
        return slipped
