"""The effects of motion: one class, one cause; its formula is the method that it overrides."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.base import Description, Parameter
from lrm_math.kinematics.chain import Number
from lrm_math.motion.base import JointDrive, MotionEffect, Values

LEAST_TORQUE = 0.02
"""N·m RMS about its mean below which a load hardly moves any joint: 0.03 rad/N·m make 0.03° of it."""
LAG_S, AT_REST = 0.15, 0.05
"""s by which a joint lags its set-point at most, and rad by which it may be off at rest."""
LEAST_INERTIA = 0.05
"""Share by which a moment of inertia must vary (RMS) to be seen."""


class ServoResponse(MotionEffect):
    """The servo as a spring with damping: without it a joint is where it was told to be."""

    id = "servo_response"
    basic = True
    about = Description(
        cause="A position servo pulls the joint to its set-point as a spring does, and brakes it.",
        formula="q̈ = ω² (u − q) − 2ζω q̇, ω = 2πf",
        source="second-order servo; Åström & Murray 2008, section 7.3",
        claim="the servo of {place} follows at {frequency_Hz}, damping ratio {damping_ratio}",
    )
    parameters = (
        Parameter("frequency_Hz", "undamped natural frequency of the loop", 4.0, 0.3, 14.0, scan=(1.5, 3.0, 6.0)),
        Parameter("damping_ratio", "share of critical damping", 0.7, 0.02, 6.0, scan=(0.4, 0.8, 1.6)),
    )

    @staticmethod
    def spring(p: Values) -> tuple[Array, Array]:
        """ω (rad/s) and 2ζω (1/s), (P, 1)."""
        omega = 2.0 * np.pi * p[0]
        return omega, 2.0 * p[1] * omega


class RestOffset(MotionEffect):
    """Difference of the zeros of command and encoder."""

    id = "rest_offset"
    basic = True
    names_a_cause = False
    about = Description(
        cause="Command and encoder count from zeros that differ a little.",
        formula="reading = q + b",
        source="calibration of leader and follower",
        claim="{place} reads {b_rad:above|below} its command",
    )
    parameters = (Parameter("b_rad", "reading less angle", 0.02, -0.5, 0.5, scan=(0.0,)),)

    def reading(self, q: Array, drive: JointDrive, p: Values) -> Array:
        """q + b."""
        return q + p[0]

    def angle(self, reading: Array, p: Values) -> Array:
        """Reading − b."""
        return reading - p[0]


class DeadTime(MotionEffect):
    """Time from a command until the servo acts on it."""

    id = "dead_time"
    about = Description(
        cause="Bus, controller and servo pass a command on only after some time.",
        formula="u(t) = command(t − T)",
        source="transport delay; Åström & Murray 2008, section 2.2",
        claim="the servo of {place} acts {t_s} after its command",
    )
    parameters = (Parameter("t_s", "delay of the command", 0.03, 0.0, 0.3, scan=(0.01, 0.03, 0.07)),)

    def set_point(self, u: Array, drive: JointDrive, p: Values) -> Array:
        """The set-point T earlier: the mean over the step of one that is constant over each."""
        return delayed(u, p[0] / drive.h)


class SensorDelay(MotionEffect):
    """Time from an angle until it is read."""

    id = "sensor_delay"
    about = Description(
        cause="An encoder's filter, or the bus, reports an angle late.",
        formula="reading(t) = q(t − T)",
        source="transport delay; Åström & Murray 2008, section 2.2",
        claim="the angle of {place} is read {t_s} late",
        needs="the load's torque known better, or a clock shared by command and reading",
    )
    alike = "a delay of the reading and one of the command act alike: dead_time stands for their sum"
    parameters = (Parameter("t_s", "delay of the reading", 0.01, 0.0, 0.3, scan=(0.01, 0.03)),)

    def reading(self, q: Array, drive: JointDrive, p: Values) -> Array:
        """The angle T earlier."""
        return delayed(q, p[0] / drive.h)


class SpeedLimit(MotionEffect):
    """Profile of the servo: its set-point goes no faster than a speed."""

    id = "speed_limit"
    about = Description(
        cause="The servo's firmware leads its set-point to the goal at a limited speed.",
        formula="|du/dt| ≤ v",
        source="Feetech STS3215, register Goal_Velocity",
        claim="the servo of {place} goes no faster than {v_rad_per_s}",
        needs="moves faster than the limit",
    )
    parameters = (Parameter("v_rad_per_s", "largest speed", 3.0, 0.05, 30.0, scan=(0.5, 1.0, 1.8, 3.0)),)

    def set_point(self, u: Array, drive: JointDrive, p: Values) -> Array:
        """Rate limiter, the mean over each step."""
        out, most = np.empty_like(u), p[0] * drive.h
        begun = _begun(u[0], drive, p[0] * LAG_S)
        for k in range(len(u)):
            step = np.clip(u[k] - begun, -most, most)
            begun = begun + step
            out[k] = begun - 0.5 * step * np.abs(step) / most  # the mean: it reaches the goal within the step
        return out


class AccelerationLimit(MotionEffect):
    """Profile of the servo: its set-point speeds up and slows down no faster than an acceleration."""

    id = "acceleration_limit"
    about = Description(
        cause="The servo's firmware leads its set-point to the goal with a limited acceleration.",
        formula="|d²u/dt²| ≤ a, braking in time for the goal",
        source="Feetech STS3215, register Acceleration",
        claim="the servo of {place} speeds up no faster than {a_rad_per_s2}",
        needs="quick starts and stops",
    )
    parameters = (
        Parameter(
            "a_rad_per_s2", "largest acceleration", 20.0, 0.5, 500.0, scan=(4.0, 10.0, 25.0, 60.0), largest=500.0
        ),
    )

    def set_point(self, u: Array, drive: JointDrive, p: Values) -> Array:
        """Trapezoidal profile: time-optimal to the goal of each step, in closed form; the mean over the step."""
        out, a, h = np.empty_like(u), p[0], drive.h
        begun = _begun(u[0], drive, np.abs(drive.speed) * LAG_S + AT_REST)
        speed = np.broadcast_to(drive.speed, begun.shape)
        for k in range(len(u)):
            ahead = u[k] - begun
            side = np.where(2.0 * a * ahead >= speed * np.abs(speed), 1.0, -1.0)  # else it must brake, or turn back
            v = side * speed
            top = np.sqrt(np.maximum(a * side * ahead + 0.5 * v**2, 0.0))
            rising = np.clip((top - v) / a, 0.0, h)
            falling = np.minimum(top / a, h - rising)
            fast = v + a * rising
            after = fast - a * falling
            gained, lost = 0.5 * (v + fast) * rising, 0.5 * (fast + after) * falling
            area = 0.5 * v * rising**2 + a * rising**3 / 6.0 + gained * (h - rising)
            area = area + 0.5 * fast * falling**2 - a * falling**3 / 6.0 + lost * (h - rising - falling)
            out[k] = begun + side * area / h
            begun, speed = begun + side * (gained + lost), side * after
        return out


class DriveLimit(MotionEffect):
    """Saturation of the servo's drive: from a deflection on it pulls no harder."""

    id = "drive_limit"
    about = Description(
        cause="Voltage, current limit or the torque register bound what the motor gives.",
        formula="torque = K sat(u − q, e)",
        source="saturation; Feetech STS3215, register Torque_Limit",
        claim="the drive of {place} is at its limit from {e_rad} of deflection on",
        needs="moves fast enough to reach the limit",
    )
    parameters = (Parameter("e_rad", "deflection at the limit", 0.2, 0.005, 3.0, scan=(0.05, 0.12, 0.3)),)

    def saturation(self, p: Values) -> Array:
        """e."""
        return np.asarray(p[0])


class MotionGain(MotionEffect):
    """A servo that turns more or less than told."""

    id = "motion_gain"
    about = Description(
        cause="Command and encoder have different scales.",
        formula="u = (1 + g) command",
        source="calibration of leader and follower",
        claim="{place} turns {g_rad_per_rad:more|less} than told",
    )
    parameters = (Parameter("g_rad_per_rad", "relative error", 0.02, -0.5, 0.5, scan=(-0.02, 0.02)),)

    def set_point(self, u: Array, drive: JointDrive, p: Values) -> Array:
        """(1 + g) u."""
        return (1.0 + p[0]) * u


class VelocityFeedforward(MotionEffect):
    """A servo whose damping acts on the error, not on the joint's speed: it leads while the command moves."""

    id = "velocity_feedforward"
    about = Description(
        cause="The D term of the controller acts on the error: a moving set-point pushes too.",
        formula="u ← u + T du/dt",
        source="PD control of the error; Åström & Murray 2008, section 10.5",
        claim="the servo of {place} leads its set-point by {t_s}",
    )
    parameters = (Parameter("t_s", "lead", 0.02, 0.0, 0.5, scan=(0.01, 0.03, 0.08)),)

    def lead(self, p: Values) -> Number:
        """T."""
        return p[0]


class GravitySag(MotionEffect):
    """A servo that yields to gravity, and as much to the inertia of what it carries."""

    id = "gravity_sag"
    about = Description(
        cause="A servo without integral action yields as a spring: to gravity, and to inertia.",
        formula="push = k (τ_gravity + τ_inertia), J = J₀ + M − M₀, J₀ = 1/(k ω²)",
        source="droop of a proportional controller; Conenna 2024, Eq 2.49",
        claim="the servo of {place} yields by {k_rad_per_Nm}",
        needs="postures with different torque",
    )
    parameters = (Parameter("k_rad_per_Nm", "compliance of the servo", 0.03, 0.0, 1.0, scan=(0.01, 0.05)),)

    def push(self, drive: JointDrive, p: Values) -> Number:
        """k τ."""
        return p[0] * drive.gravity[:, None]

    def compliance(self, p: Values) -> Number:
        """k."""
        return p[0]

    def missing_excitation(self, drive: JointDrive) -> str | None:
        """Gravity's torque must vary."""
        return None if np.std(drive.gravity) > LEAST_TORQUE else "gravity's torque on it hardly varies"


class InertialCoupling(MotionEffect):
    """Other joints' acceleration pushes a joint: coupled swing."""

    id = "inertial_coupling"
    about = Description(
        cause="What accelerates one joint pushes the others. Integral action holds gravity.",
        formula="push = k (Σ_j M_ij q̈_j, centrifugal), J = J₀ + M − M₀, J₀ = 1/(k ω²)",
        source="Siciliano et al. 2009, section 7.2; point masses",
        claim="the servo of {place} yields by {k_rad_per_Nm} to what other joints push it with",
        needs="quick moves of several joints at once",
    )
    parameters = (Parameter("k_rad_per_Nm", "compliance of the servo", 0.03, 0.0, 1.0, scan=(0.01, 0.05)),)

    def compliance(self, p: Values) -> Number:
        """k."""
        return p[0]

    def missing_excitation(self, drive: JointDrive) -> str | None:
        """The other joints must push it."""
        return None if np.std(drive.reaction) > LEAST_TORQUE else "the other joints hardly push it in these moves"


class LinkInertia(MotionEffect):
    """Inertia of the links beside the armature: the frequency depends on the posture."""

    id = "link_inertia"
    about = Description(
        cause="Stretched out the arm is slower to start: beside the motor's armature counts what the joint carries.",
        formula="J = J₀ (1 + s (M/M₀ − 1)), M the links' moment of inertia, M₀ in the middle of the ranges",
        source="Siciliano et al. 2009, section 7.2; point masses",
        claim="{s_ratio} of the inertia about {place} is that of the links, the remainder armature",
        needs="quick moves in stretched and folded postures",
    )
    parameters = (Parameter("s_ratio", "share of the links", 0.4, 0.0, 1.0, scan=(0.2, 0.6)),)

    def inertia(self, drive: JointDrive, p: Values) -> Number:
        """s (M/M₀ − 1)."""
        return p[0] * (drive.inertia / drive.reference - 1.0)[:, None]

    def missing_excitation(self, drive: JointDrive) -> str | None:
        """The moment of inertia must vary."""
        if np.any(drive.reference <= LEAST_INERTIA * np.mean(drive.inertia)):
            return "in the middle of its range its links have hardly any moment of inertia"
        enough = np.std(drive.inertia) > LEAST_INERTIA * np.mean(drive.reference)
        return None if enough else "its links' moment of inertia hardly varies"


class ViscousFriction(MotionEffect):
    """Friction in proportion to speed."""

    id = "viscous_friction"
    about = Description(
        cause="Grease and bearings brake in proportion to the speed.",
        formula="torque = −K c q̇",
        source="Armstrong-Hélouvry, Dupont & Canudas de Wit 1994",
        claim="{place} is braked by {c_s} times its speed",
        needs="the motor's current",
    )
    alike = "the servo's own damping acts alike: damping_ratio of servo_response stands for their sum"
    parameters = (Parameter("c_s", "friction per speed, over the stiffness", 0.02, 0.0, 1.0, scan=(0.02,)),)

    def damping(self, drive: JointDrive, p: Values) -> Number:
        """c."""
        return p[0]


class Drag(MotionEffect):
    """Drag by a power law: braking that grows faster than the speed. Several causes have this form."""

    id = "drag"
    names_a_cause = False
    about = Description(
        cause="Quick moves are braked more: by a fluid, churned grease, losses of the motor, or a drive that weakens.",
        formula="torque = −K c |q̇|ⁿ sign q̇, n > 1, q̇ in rad/s",
        source="power law; n = 2 in turbulent fluids (MuJoCo, passive forces)",
        claim="{place} is braked by {c_rad} at 1 rad/s, and by the power {n_ratio} of the speed",
        needs="quick and slow moves",
    )
    parameters = (
        Parameter("c_rad", "braking at 1 rad/s, over the stiffness", 0.01, 0.0, 1.0, scan=(0.003, 0.02)),
        Parameter("n_ratio", "power of the speed", 2.0, 1.2, 4.0, scan=(2.0,)),
    )

    def friction_at(self, speed: Array, p: Values) -> Number:
        """c |q̇|ⁿ."""
        return np.asarray(p[0] * np.abs(speed) ** p[1])


class CoulombFriction(MotionEffect):
    """Dry friction: the joint stops short of its set-point, on the side that it came from."""

    id = "coulomb_friction"
    about = Description(
        cause="Gears rub, and a small error is too weak to turn them.",
        formula="|f| ≤ c, against the motion",
        source="Armstrong-Hélouvry, Dupont & Canudas de Wit 1994",
        claim="{place} stops up to {c_rad} short of its set-point",
        needs="reversals and stops",
    )
    parameters = (Parameter("c_rad", "friction over the stiffness", 0.01, 0.0, 0.5, scan=(0.003, 0.01, 0.03)),)

    def friction(self, drive: JointDrive, p: Values) -> Number:
        """c."""
        return p[0]


class LoadFriction(MotionEffect):
    """Friction of loaded gears."""

    id = "load_friction"
    about = Description(
        cause="Teeth that bear a load rub in proportion to it.",
        formula="|f| ≤ m |τ_gravity|",
        source="Hamon et al. 2010: load-dependent friction of harmonic drives and gears",
        claim="friction of {place} grows with its load by {m_rad_per_Nm}",
        needs="postures with different torque, reversals and stops",
    )
    parameters = (Parameter("m_rad_per_Nm", "friction per load", 0.02, 0.0, 1.0, scan=(0.01, 0.04)),)

    def friction(self, drive: JointDrive, p: Values) -> Number:
        """m |τ|."""
        return p[0] * np.abs(drive.gravity)[:, None]

    def missing_excitation(self, drive: JointDrive) -> str | None:
        """The load must vary."""
        varies = np.std(np.abs(drive.gravity)) > LEAST_TORQUE
        return None if varies else "the load on it hardly varies"


class StribeckFriction(MotionEffect):
    """Friction that is larger at rest than in motion: the joint sticks and jumps."""

    id = "stribeck"
    about = Description(
        cause="Standing surfaces hold each other more than moving ones: slow motion goes in jumps (stick–slip).",
        formula="|f| ≤ s exp(−(q̇/v)²)",
        source="Stribeck curve; Armstrong-Hélouvry, Dupont & Canudas de Wit 1994",
        claim="{place} needs {s_rad} more to start than to go on",
        needs="slow moves",
    )
    parameters = (
        Parameter("s_rad", "further friction at rest, over the stiffness", 0.01, 0.0, 0.3, scan=(0.005, 0.015)),
        Parameter("v_rad_per_s", "speed at which it fades", 0.1, 0.01, 1.0, scan=(0.05, 0.2)),
    )

    def friction_at(self, speed: Array, p: Values) -> Number:
        """s exp(−(q̇/v)²)."""
        return np.asarray(p[0] * np.exp(-((speed / p[1]) ** 2)))


class MotionPlay(MotionEffect):
    """Play between servo and sensor that the motion crosses at every reversal."""

    id = "motion_play"
    about = Description(
        cause="Gears have play: after a reversal the joint waits until they touch again.",
        formula="play operator of width b",
        source="Tao & Kokotović 1996",
        claim="{place} has {b_rad} of play, end to end, crossed at each reversal",
        needs="reversals",
    )
    parameters = (Parameter("b_rad", "play, end to end", 0.02, 0.0, 0.5, scan=(0.005, 0.02, 0.05)),)

    def reading(self, q: Array, drive: JointDrive, p: Values) -> Array:
        """The joint is carried along by either end of the play."""
        out, half = np.empty_like(q), 0.5 * p[0]
        read_out = q[0]
        for k in range(len(q)):
            read_out = np.clip(read_out, q[k] - half, q[k] + half)
            out[k] = read_out
        return out


class Swing(MotionEffect):
    """A joint that yields between its servo and its sensor, and swings there."""

    id = "swing"
    about = Description(
        cause="What is between the motor and the sensor is a spring: the link swings on it.",
        formula="ÿ = ω² (q − y) + 2ζω (q̇ − ẏ), and m J₀ ÿ pushes the servo back",
        source="series elasticity; Spong 1987",
        claim="{place} swings at {frequency_Hz}, damping ratio {damping_ratio}",
        needs="quick starts and stops",
    )
    parameters = (
        Parameter("frequency_Hz", "natural frequency", 5.0, 0.5, 14.0, scan=(1.6, 2.1, 2.7, 3.5, 4.5, 5.8, 7.5, 10.0)),
        Parameter("damping_ratio", "share of critical damping", 0.05, 0.003, 1.0, scan=(0.04, 0.15)),
        Parameter(
            "mass_ratio", "inertia of what swings, over the servo's", 0.05, 0.0, 5.0, 0.0, scan=(0.0,), largest=5.0
        ),
    )

    def hung(self, p: Values) -> tuple[Array, Array, Array] | None:
        """The link."""
        omega = 2.0 * np.pi * p[0]
        return omega**2, 2.0 * p[1] * omega, p[2]


def _begun(goal: Array, drive: JointDrive, ahead: Array) -> Array:
    """(P, S), where a set-point is at the beginning: at its goal (P, S), but no farther `ahead` of the joint (rad)."""
    return np.asarray(drive.start + np.clip(goal - drive.start, -ahead, ahead))


def delayed(u: Array, steps: Array) -> Array:
    """(M, P, S), values of u that many steps earlier, (P, 1) or (P, S), straight between; before the first it stood."""
    if np.shape(steps)[-1] > 1:
        return np.concatenate([delayed(u[..., [k]], steps[:, [k]]) for k in range(steps.shape[1])], axis=-1)
    out = np.empty_like(u)
    for row, count in enumerate(np.asarray(steps, dtype=np.float64).reshape(-1).tolist()):
        whole = int(count)
        part, last = count - whole, len(u) - 1
        at = np.clip(np.arange(len(u)) - whole, 0, last)
        before = np.clip(at - 1, 0, last)
        out[:, row] = (1.0 - part) * u[at, row] + part * u[np.where(np.arange(len(u)) > whole, before, 0), row]
    return out


MOTION_EFFECTS: tuple[type[MotionEffect], ...] = (
    ServoResponse,
    RestOffset,
    DeadTime,
    SensorDelay,
    SpeedLimit,
    AccelerationLimit,
    DriveLimit,
    MotionGain,
    VelocityFeedforward,
    GravitySag,
    InertialCoupling,
    LinkInertia,
    ViscousFriction,
    Drag,
    CoulombFriction,
    LoadFriction,
    StribeckFriction,
    MotionPlay,
    Swing,
)
"""The catalogue, in the order in which a tie is broken: the simpler first."""
