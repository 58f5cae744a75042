"""Simulated servos and arm: finite speed, dead band, heating, links that swing on springs, the true TCP."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.servo_table import PwmClock, ServoTable
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import with_load_at
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrmd.config import SHIPPED, load_config
from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameDecoder, encode
from lrmd.sim.arm import AMBIENT, SimulatedArm
from lrmd.sim.board import SimulatedBoard
from lrmd.sim.control_socket import answer_query
from lrmd.sim.launch import simulated_board
from lrmd.sim.pca9685_chip import Pca9685Chip
from lrmd.sim.process import springs_of
from lrmd.sim.servo import LARGE_SERVO, SMALL_SERVO, ServoKind, backdrive_speed, remaining_travel, winding_rise
from lrmd.sim.simulation import Simulation
from lrmd.sim.swing import JointSpring, SwingingLinks, inertia
from tests.support.random_arms import random_arm
from tests.support.sweep import examples

MS, SECOND = 1_000_000, 1_000_000_000
CLOCK = PwmClock(330.0)
TABLE = ServoTable((-2.0, 0.0, 2.0), (600e-6, 1510e-6, 2400e-6))
kinds = st.builds(ServoKind, speed=st.floats(0.5, 20.0), lag=st.floats(1e-3, 0.3))
seconds = st.floats(0.0, 1.0)


class BoardOnBench:
    """A board with an arm, a clock and a host."""

    def __init__(
        self, truth: Model, start: Sequence[float] | None = None, dead_band: float = 0.0, clock: PwmClock = CLOCK
    ) -> None:
        arm = truth.arm
        self.tables = [joint.servo for joint in arm.joints]
        channels = {name: channel for channel, name in enumerate(arm.joint_names)}
        self.arm = SimulatedArm(truth, channels, start, dead_band=dead_band)
        self.link = Simulation(SimulatedBoard(Pca9685Chip(clock.oscillator_hz), Random(1)), self.arm, Random(1))
        self.clock, self.now = clock, 0
        self.send(protocol.setup(0, clock.prescale, 10_000))

    def send(self, frame: Frame) -> None:
        (reply,) = FrameDecoder().feed(self.link.feed(encode(frame), self.now))
        assert isinstance(reply, Frame)
        protocol.ack_of(reply)

    def command(self, q: Sequence[float], tables: Sequence[ServoTable] | None = None) -> list[float]:
        """Sends angles through `tables`; returns the angles of the rounded counts by the servos' own tables."""
        used = tables or self.tables
        pulses = [float(table.pulse_of(angle)) for table, angle in zip(used, q, strict=True) if table]
        counts = [int(count) for count in self.clock.counts_of(pulses)]
        self.send(protocol.arm(1, dict(enumerate(counts))))
        real = self.clock.pulse_of(counts)
        return [float(table.angle_of(p)) for table, p in zip(self.tables, real, strict=True) if table]

    def off(self) -> None:
        self.send(protocol.arm(2, dict.fromkeys(range(len(self.tables)), 0)))

    def wait(self, seconds: float) -> None:
        self.now += round(seconds * SECOND)
        self.link.tick(self.now)


def servoed(arm: Arm) -> Arm:
    return replace(arm, joints=tuple(replace(joint, servo=TABLE) for joint in arm.joints))


def bent(rover: Arm) -> Model:
    """A rover arm with compliance in every joint."""
    model = model_of(rover, effects_at(rover, "compliance"))
    return model.with_values([0.06] * len(model.keys))


# One servo


@given(st.floats(-3.0, 3.0), seconds, seconds, kinds, st.floats(0.0, 0.01))
def test_two_steps_equal_one_long_step(left: float, a: float, b: float, kind: ServoKind, band: float) -> None:
    stepwise = remaining_travel(remaining_travel(left, a, kind, band), b, kind, band)
    assert stepwise == pytest.approx(remaining_travel(left, a + b, kind, band), abs=1e-8)


@given(st.floats(-3.0, 3.0), seconds, kinds, st.floats(0.0, 0.01))
def test_speed_limit_without_overshoot(left: float, dt: float, kind: ServoKind, band: float) -> None:
    after = remaining_travel(left, dt, kind, band)
    assert after * left >= 0.0
    assert abs(left) - kind.speed * dt - 1e-8 <= abs(after) <= abs(left)
    if abs(left) <= band:
        assert after == left


def test_long_travel_takes_the_catalogue_time() -> None:
    way, dt = math.radians(60.0), 0.1
    assert way - remaining_travel(way, dt, LARGE_SERVO, 0.0) == pytest.approx(math.radians(60.0) / 0.15 * dt)
    assert remaining_travel(way, 10.0, LARGE_SERVO, 0.0) == 0.0


@given(st.floats(-2.0, 2.0), st.floats(0.0, 0.5))
def test_back_driven_once_the_load_exceeds_the_friction(torque: float, more: float) -> None:
    speed = backdrive_speed(torque, SMALL_SERVO)
    assert speed * torque >= 0.0
    if abs(torque) <= SMALL_SERVO.friction:
        assert speed == 0.0
    if abs(torque) > SMALL_SERVO.friction + 0.01:
        assert speed != 0.0
    assert abs(backdrive_speed(torque + math.copysign(more, torque), SMALL_SERVO)) >= abs(speed)


@given(st.floats(0.0, 200.0), st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 5000.0), st.floats(0.0, 5000.0))
def test_heat_is_monotone_in_load_and_time(rise: float, torque: float, more: float, a: float, b: float) -> None:
    end = SMALL_SERVO.rise * torque**2
    once = winding_rise(rise, torque, a, SMALL_SERVO)
    assert min(rise, end) - 1e-9 <= once <= max(rise, end) + 1e-9
    assert winding_rise(rise, torque + more, a, SMALL_SERVO) >= once - 1e-9
    twice = winding_rise(once, torque, b, SMALL_SERVO)
    assert twice == pytest.approx(winding_rise(rise, torque, a + b, SMALL_SERVO), abs=1e-9)
    assert abs(twice - end) <= abs(once - end) + 1e-9


# The arm


def test_settles_to_the_tcp_of_its_model(rover: Arm) -> None:
    truth = bent(rover)
    rig = BoardOnBench(truth)
    rng = np.random.default_rng(3)
    for _ in range(5):
        real = rig.command(rng.uniform(-1.5, 1.5, 6).tolist())
        rig.wait(1.5)
        assert not rig.arm.moving
        np.testing.assert_allclose(rig.arm.q, real, atol=1e-8)
        np.testing.assert_allclose(
            rig.arm.equilibrium().tcp[-1], solve_equilibrium(truth, poses_of(real)).tcp[0], atol=1e-8
        )


@given(st.integers(0, 1000), st.integers(1, 10))
@examples(7, 15)
def test_any_number_of_joints(seed: int, joints: int) -> None:
    truth = model_of(servoed(random_arm(seed, joints)), ())
    rig = BoardOnBench(truth)
    real = rig.command(np.random.default_rng(seed).uniform(-1.9, 1.9, joints).tolist())
    rig.wait(2.0)
    np.testing.assert_allclose(
        rig.arm.equilibrium().tcp[-1], solve_equilibrium(truth, poses_of(real)).tcp[0], atol=1e-8
    )


def test_moves_at_finite_speed_independent_of_the_step_size(rover: Arm) -> None:
    truth = model_of(rover, ())
    often, seldom = BoardOnBench(truth), BoardOnBench(truth)
    for rig in (often, seldom):
        rig.command([0.0] * 6)
        rig.wait(2.0)
        rig.command([1.5] * 6)
    before = often.arm.q
    for _ in range(40):
        often.wait(0.005)
        step = np.subtract(often.arm.q, before)
        assert np.all(step > 0.0)
        assert np.all(step <= LARGE_SERVO.speed * 0.005 + 1e-12)
        before = often.arm.q
    seldom.wait(0.2)
    np.testing.assert_allclose(often.arm.q, seldom.arm.q, atol=1e-9)


def test_stays_inside_its_dead_band_on_the_side_it_comes_from(rover: Arm) -> None:
    rig = BoardOnBench(model_of(rover, ()), dead_band=4e-6)
    ends = []
    for start in (-0.5, 0.5):
        rig.command([start] * 6)
        rig.wait(2.0)
        real = rig.command([0.2] * 6)
        rig.wait(2.0)
        ends.append(np.subtract(rig.arm.q, real))
    width = 4e-6 * math.radians(200.0) / 1840e-6  # joint 1: 200 degrees for 1840 us
    assert ends[0][0] == pytest.approx(-width)
    assert ends[1][0] == pytest.approx(width)


def test_without_pulses_it_sinks_and_its_energy_falls(lawful: Arm) -> None:
    truth = model_of(servoed(lawful), ())
    rig = BoardOnBench(truth, start=[0.4, 0.9, -0.6, 0.5, 0.3, 0.1])

    def torque_and_q() -> tuple[np.ndarray, np.ndarray]:
        return solve_equilibrium(truth, poses_of(rig.arm.q)).joint_torque[0], np.array(rig.arm.q)

    torque, q = torque_and_q()
    fallen = 0.0
    for _ in range(200):
        rig.wait(0.05)
        after, q_after = torque_and_q()
        work = float(0.5 * (torque + after) @ (q_after - q))  # gravity's: minus the change of potential energy
        assert work >= -1e-4
        assert np.all(np.abs(q_after - q) <= LARGE_SERVO.speed * 0.05 + 1e-12)
        fallen += work
        torque, q = after, q_after
    assert fallen > 0.1
    assert not rig.arm.moving
    for servo, load in zip(rig.arm.joints, torque, strict=True):
        stopped = servo.angle in (servo.lower, servo.upper)
        assert stopped or abs(load) <= servo.kind.friction + 2e-3


def test_silence_of_the_host_unpowers_the_arm(rover: Arm) -> None:
    rig = BoardOnBench(model_of(rover, ()))
    rig.command([0.3, 1.2, 0.3, 0.3, 0.3, 0.3])
    rig.wait(2.0)
    held = rig.arm.q
    rig.wait(7.9)
    assert rig.arm.q == held
    rig.wait(0.2)
    rig.wait(2.0)
    assert all(servo.unpowered for servo in rig.arm.servos)
    assert rig.arm.q[1] != held[1]


def test_too_short_pulses_leave_a_servo_unpowered(rover: Arm) -> None:
    rig = BoardOnBench(model_of(rover, ()))
    short = int(rig.clock.counts_of(100e-6))
    rig.send(protocol.arm(1, {0: short, 1: int(rig.clock.counts_of(1500e-6))}))
    rig.wait(1.0)
    assert rig.arm.servos[0].unpowered
    assert not rig.arm.servos[1].unpowered


def test_end_stops_hold(rover: Arm) -> None:
    rig = BoardOnBench(model_of(rover, ()))
    rig.command([2.2] * 6)
    rig.wait(3.0)
    for servo, joint in zip(rig.arm.joints, rover.joints, strict=True):
        assert joint.upper < servo.angle <= joint.upper + math.radians(5.0) + 1e-12


def test_wrong_servo_tables_shift_the_angles(rover: Arm) -> None:
    stretched = [ServoTable(j.servo.angle, tuple(1.02 * p for p in j.servo.pulse)) for j in rover.joints if j.servo]
    true_arm = replace(rover, joints=tuple(replace(j, servo=t) for j, t in zip(rover.joints, stretched, strict=True)))
    nominal = [joint.servo for joint in rover.joints if joint.servo]
    rig = BoardOnBench(model_of(true_arm, ()))
    rig.command([0.5] * 6, nominal)
    rig.wait(2.0)
    wanted = [float(t.angle_of(n.pulse_of(0.5))) for t, n in zip(stretched, nominal, strict=True)]
    np.testing.assert_allclose(rig.arm.q, wanted, atol=CLOCK.count_s * math.radians(200.0) / 1.8e-3)
    assert np.all(np.abs(np.subtract(rig.arm.q, 0.5)) > 0.02)


def test_hidden_hysteresis_depends_on_where_it_comes_from(rover: Arm) -> None:
    truth = model_of(rover, effects_at(rover, "hysteresis@joint2"), {"hysteresis.joint2.h_rad": 0.03})
    rig = BoardOnBench(truth)
    seen = []
    for start in (-0.5, 0.5):
        rig.command([0.2, start, 0.2, 0.2, 0.2, 0.2])
        rig.wait(2.0)
        rig.command([0.2] * 6)
        rig.wait(2.0)
        seen.append(rig.arm.equilibrium().tcp[-1])
    ways = np.zeros((2, 6))
    ways[:, 1] = 1.0, -1.0
    q = np.tile(rig.arm.q, (2, 1))
    expected = solve_equilibrium(truth, Poses(q, np.zeros(2), direction=ways)).tcp
    np.testing.assert_allclose(np.subtract(*seen), expected[0] - expected[1], atol=1e-8)
    assert np.linalg.norm(np.subtract(*seen)) > 5e-3


def test_hidden_sessions_and_drift_follow_power_and_time(rover: Arm) -> None:
    effects = effects_at(rover, "session@joint1") + effects_at(rover, "drift@joint1")
    steps = {"session.joint1.step3_rad": 0.02, "drift.joint1.A_rad": 0.05, "drift.joint1.T_s": 600.0}
    truth = model_of(rover, effects, steps)
    plain = model_of(rover, ())
    rig = BoardOnBench(truth)

    def turned() -> float:
        a, b = rig.arm.equilibrium().tcp[-1], solve_equilibrium(plain, poses_of(rig.arm.q)).tcp[0]
        return float(np.linalg.norm(a - b))

    def hold(seconds: int) -> None:
        for _ in range(seconds):
            rig.command([0.0, 1.2, 0.0, 0.0, 0.0, 0.0])
            rig.wait(1.0)

    hold(3)
    rig.arm.power_cycle()
    assert turned() < 1e-4
    rig.arm.power_cycle()
    third = turned()
    assert third > 1e-3
    hold(597)
    assert turned() / third == pytest.approx((0.02 + 0.05 * (1 - math.exp(-1))) / 0.02, rel=0.05)


def test_load_bends_the_arm_and_heats_the_servos(rover: Arm) -> None:
    truth = bent(rover)
    rig = BoardOnBench(truth)

    def hold(seconds: int) -> None:
        for _ in range(seconds):
            rig.command([0.0, 0.3, 0.0, 1.2, 0.0, 0.0])
            rig.wait(1.0)

    hold(60)
    light, cool = rig.arm.equilibrium().tcp[-1], [rig.arm.temperature(servo) for servo in rig.arm.servos]
    rig.arm.set_payload(0.1)
    heavy = rig.arm.equilibrium().tcp[-1]
    np.testing.assert_allclose(heavy, solve_equilibrium(truth, poses_of(rig.arm.q, 0.1)).tcp[0], atol=1e-8)
    assert heavy[2] < light[2] - 1e-3
    at, q = (0.02, -0.01, 0.05), rig.arm.q
    rig.arm.set_payload(0.1, at)
    outward = rig.arm.equilibrium().tcp[-1]
    np.testing.assert_allclose(outward, solve_equilibrium(with_load_at(truth, at), poses_of(q, 0.1)).tcp[0], atol=1e-8)
    assert np.linalg.norm(outward - heavy) > 1e-4
    rig.arm.set_payload(0.1)
    np.testing.assert_allclose(rig.arm.equilibrium().tcp[-1], heavy, atol=1e-9)
    hold(60)
    warm = [rig.arm.temperature(servo) for servo in rig.arm.servos]
    assert all(b >= a - 1e-9 for a, b in zip(cool, warm, strict=True))
    assert warm[1] > cool[1] + 1.0
    rig.off()
    rig.wait(60.0)
    assert rig.arm.temperature(rig.arm.servos[1]) < warm[1]


def test_a_faster_board_clock_heats_no_faster(rover: Arm) -> None:
    truth = model_of(rover, ())
    channels = {name: channel for channel, name in enumerate(rover.joint_names)}
    rises = []
    for speed in (1.0, 6.0):
        arm, chip = SimulatedArm(truth, channels, [0.3] * 6, speed=speed), Pca9685Chip(CLOCK.oscillator_hz)
        for servo in arm.servos:
            servo.target, servo.torque = servo.angle, 0.2
        arm.advance(chip, round(60.0 * speed * SECOND))
        rises.append([arm.temperature(servo) for servo in arm.servos])
    assert min(rises[0]) > AMBIENT
    assert rises[1] == pytest.approx(rises[0], rel=1e-3)


def test_overloaded_wrist_servo_burns_out(rover: Arm) -> None:
    rig = BoardOnBench(model_of(rover, ()))
    rig.arm.set_payload(0.3)
    # joint 4 level with the ground and all the load on it
    loads = solve_equilibrium(rig.arm.truth, poses_of(np.random.default_rng(0).uniform(-1.5, 1.5, (500, 6)), 0.3))
    worst = int(np.argmax(np.abs(loads.joint_torque[:, 3])))
    q = loads.poses.q[worst].tolist()
    burnt_at = None
    for second in range(3600):
        rig.command(q)
        rig.wait(1.0)
        if rig.arm.servos[3].burnt:
            burnt_at = second
            break
    assert burnt_at is not None
    held = rig.arm.q[3]
    for _ in range(5):
        rig.command(q)
        rig.wait(1.0)
    assert rig.arm.servos[3].unpowered
    assert rig.arm.q[3] != held


@pytest.mark.slow
def test_tracker_noise_has_the_given_deviation_and_the_true_tcp_none(rover: Arm) -> None:
    truth = model_of(rover, effects_at(rover, "measurement_frame"), {"measurement_frame.frame.scale_z_mm_per_m": 0.01})
    rig = BoardOnBench(truth)
    true = answer_query(rig.link, "tcp", rig.now, Random(1), 3e-4)
    random = Random(5)
    seen = [answer_query(rig.link, "measure", rig.now, random, 3e-4) for _ in range(2000)]
    z = np.array([float(str(one["z_mm"])) for one in seen])
    where = float(str(true["z_mm"]))
    assert z.std() == pytest.approx(0.3, rel=0.1)
    assert z.mean() == pytest.approx(where * 1.01, abs=0.03)
    assert answer_query(rig.link, "tcp", rig.now, random, 3e-4) == true


def test_invalid_simulations_are_refused(rover: Arm) -> None:
    joints = {name: channel for channel, name in enumerate(rover.joint_names)}
    with pytest.raises(LrmError, match="quantisation"):
        SimulatedArm(model_of(rover, effects_at(rover, "quantisation")), joints)
    with pytest.raises(UnknownName, match="joint7"):
        SimulatedArm(model_of(rover, ()), joints | {"joint7": 6})
    with pytest.raises(LrmError, match="joint6"):
        SimulatedArm(model_of(rover, ()), {k: v for k, v in joints.items() if k != "joint6"})
    with pytest.raises(LrmError, match="channel 0"):
        SimulatedArm(model_of(rover, ()), joints | {"joint2": 0})
    with pytest.raises(LrmError, match="no servo table"):
        SimulatedArm(model_of(random_arm(1, 2), ()), {"joint1": 0, "joint2": 1})
    with pytest.raises(LrmError, match="angles"):
        SimulatedArm(model_of(rover, ()), joints, start=[0.0])
    with pytest.raises(LrmError, match="payload"):
        SimulatedArm(model_of(rover, ()), joints).set_payload(float("nan"))


ARM = load_arm("lrm-rover")
TRUTH = model_of(ARM, ())
HERE = np.array([0.3, 0.9, 0.2, 0.5, 0.1, 0.0])
STIFF = 20.0


def swung(spring: JointSpring, seconds: float = 4.0) -> np.ndarray:
    """Deflections of joint 2 (rad), every ms, after its servo stopped at once from 0.3 rad/s."""
    swing = SwingingLinks(TRUTH, {"joint2": spring})
    swing.weigh(TRUTH.chain, HERE, 0.0)
    step, out = np.array([0.0, 0.0003, 0.0, 0.0, 0.0, 0.0]), []
    for k in range(3000):
        swing.follow(HERE + (k - 3000) * step, HERE + (k - 2999) * step, 0.001)
    for _ in range(round(1000 * seconds)):
        swing.follow(HERE, HERE, 0.001)
        out.append(swing.deflection[1])
    return np.array(out)


def test_frequency_and_decay_are_those_of_spring_damper_and_inertia() -> None:
    mass, damping = float(inertia(TRUTH.chain, HERE, 0.0)[1, 1]), 0.05
    z = swung(JointSpring(STIFF, damping))
    crossings = np.flatnonzero(np.diff(np.sign(z)) > 0)
    assert 1000.0 / np.diff(crossings).mean() == pytest.approx(np.sqrt(STIFF / mass) / 2.0 / np.pi, rel=0.01)
    peaks = np.array([np.abs(part).max() for part in np.split(z, 8)])
    assert np.polyfit(0.5 * np.arange(8), np.log(peaks), 1)[0] == pytest.approx(-0.5 * damping / mass, rel=0.1)
    assert peaks[0] == pytest.approx(0.3 / np.sqrt(STIFF / mass), rel=0.15)


@pytest.mark.long
def test_friction_stops_the_swing_early_and_leaves_the_link_beside_its_place() -> None:
    friction = 0.05
    free, rubbed = swung(JointSpring(STIFF, 0.02)), swung(JointSpring(STIFF, 0.02, friction))
    assert np.ptp(rubbed[-500:]) == 0.0
    assert np.ptp(free[-500:]) > 1e-3
    assert 0.0 < abs(rubbed[-1]) <= 1.5 * friction / STIFF


def test_a_tracker_sees_the_tip_swing_after_a_move_and_come_to_rest() -> None:
    """Without springs the tip stands as soon as the servos do."""
    channels = {name: channel for channel, name in enumerate(ARM.joint_names)}

    def range_mm(springs: dict[str, JointSpring]) -> list[float]:
        rig = BoardOnBench(TRUTH)
        rig.arm = rig.link.arm = SimulatedArm(TRUTH, channels, dead_band=0.0, springs=springs)
        q = [0.0, 0.5, 0.0, 0.0, 0.0, 0.0]
        rig.command([0.0] * 6)
        rig.command(q)
        rig.wait(1.0)
        seen = []
        for _ in range(2):
            z = []
            for _ in range(40):
                rig.wait(0.01)
                z.append(
                    [float(str(answer_query(rig.link, "tcp", rig.now, Random(1), 0.0)[k])) for k in ("x_mm", "z_mm")]
                )
            seen.append(float(np.ptp(np.array(z), axis=0).max()))
            rig.wait(3.0)
            assert not rig.arm.moving
        return seen

    assert range_mm({})[0] < 0.01
    swinging = range_mm({"joint2": JointSpring(STIFF, 0.2)})
    assert swinging[0] > 2.0 > 0.01 > swinging[1]


def test_springs_of_the_configuration_reach_the_simulated_board(tmp_path, monkeypatch) -> None:
    text = SHIPPED.read_text().replace('directory = "/var/lib/lrmd"', f'directory = "{tmp_path}"')
    path = tmp_path / "lrmd.toml"
    spring = "stiffness_nm_per_rad = 20.0\ndamping_nm_s_per_rad = 0.04\n"
    path.write_text(f"{text}\n[simulation.spring.joint2]\n{spring}")
    started: list[list[str]] = []

    def popen(command, **_):
        started.append(command)
        raise LrmError("enough")

    monkeypatch.setattr("lrmd.sim.launch.subprocess.Popen", popen)
    with pytest.raises(LrmError, match="enough"), simulated_board(load_config(path)):
        pass
    assert "--spring=joint2=20.0:0.04:0.0" in started[0]
    path.write_text(f"{text}\n[simulation.spring.joint9]\n{spring}")
    with pytest.raises(LrmError, match="joint9"):
        load_config(path)


def test_bad_springs_are_refused() -> None:
    assert springs_of(["joint2=20:0.1", "joint1=5:0.1:0.2"])["joint1"] == JointSpring(5.0, 0.1, 0.2)
    for text in ("joint2", "joint2=a:1", "joint2=20", "joint2=20:0.1:nan", "joint2=0:0.1"):
        with pytest.raises(LrmError, match="spring"):
            springs_of([text])
    with pytest.raises(UnknownName, match="joint9"):
        SwingingLinks(TRUTH, {"joint9": JointSpring(1.0, 0.1)})
