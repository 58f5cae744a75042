"""Laws of the effects of motion: what each does to a joint, whatever its size."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.statics import joint_torques
from lrm_math.motion import simulation
from lrm_math.motion.base import JointDrive, MotionEffect
from lrm_math.motion.effects import (
    MOTION_EFFECTS,
    AccelerationLimit,
    CoulombFriction,
    DeadTime,
    Drag,
    DriveLimit,
    GravitySag,
    InertialCoupling,
    LinkInertia,
    MotionPlay,
    RestOffset,
    ServoResponse,
    SpeedLimit,
    StribeckFriction,
    Swing,
    VelocityFeedforward,
)
from lrm_math.motion.loads import joint_loads
from lrm_math.motion.simulation import simulate
from lrm_math.motion.spring_step import two_masses
from tests.support.sweep import examples

ARM = load_arm("so101")
H, STEPS = 0.008, 400
NONE = np.zeros((STEPS, 1))


def drive(command: Array, start: float = 0.0) -> JointDrive:
    """A joint without loads."""
    at = np.full(1, start)
    return JointDrive(H, command[:, None], NONE, NONE, np.ones((STEPS, 1)), 1.0, at, np.zeros(1))


def moved(command: Array, *effects: tuple[type[MotionEffect], tuple[float, ...]]) -> Array:
    """(M + 1,), readings of a joint with effects and their values."""
    values = [[np.array([[value]]) for value in p] for _, p in effects]
    kinds = [kind(ARM, "joint2") for kind, _ in effects]
    return simulate(kinds, values, drive(command, float(command[0])))[:, 0, 0]


def step(size: float) -> Array:
    """A command that jumps after a tenth of the time."""
    return size * (np.arange(STEPS) >= STEPS // 10)


def test_a_servo_is_the_second_order_system_of_the_textbook() -> None:
    """Åström & Murray 2008, Eq 6.25: 1 − exp(−ζωt) (cos ω_d t + ζω/ω_d sin ω_d t)."""
    frequency, damping = 3.0, 0.3
    omega = 2.0 * np.pi * frequency
    found = moved(step(0.5), (ServoResponse, (frequency, damping)))[STEPS // 10 :]
    t, swings = H * np.arange(len(found)), omega * np.sqrt(1.0 - damping**2)
    expected = 1.0 - np.exp(-damping * omega * t) * (np.cos(swings * t) + damping * omega / swings * np.sin(swings * t))
    np.testing.assert_allclose(found, 0.5 * expected, atol=1e-9)


@given(st.floats(0.0, 0.2), st.floats(1.0, 8.0))
@examples(10, 20)
def test_a_dead_time_shifts_the_response_and_changes_nothing_else(late: float, frequency: float) -> None:
    steps = round(late / H)
    plain = moved(step(0.4), (ServoResponse, (frequency, 0.7)))
    late_one = moved(step(0.4), (ServoResponse, (frequency, 0.7)), (DeadTime, (steps * H,)))
    np.testing.assert_allclose(late_one[steps:], plain[: len(plain) - steps], atol=1e-12)


@given(st.floats(0.001, 0.1), st.floats(-1.0, 1.0), st.floats(0.4, 1.5))
@examples(10, 20)
def test_dry_friction_stops_a_joint_within_its_band_and_never_starts_it(
    band: float, size: float, damping: float
) -> None:
    found = moved(step(size), (ServoResponse, (4.0, damping)), (CoulombFriction, (band,)))
    assert abs(found[-1] - size) <= band + 1e-9
    assert found[-1] == pytest.approx(found[-20], abs=1e-9)  # it stands
    if abs(size) <= band:
        assert not found.any()


@given(st.floats(0.0, 0.2))
@examples(10, 20)
def test_play_lags_by_half_its_width_on_the_side_that_the_joint_came_from(width: float) -> None:
    there, back = np.full(STEPS, 0.5), np.full(STEPS, -0.5)
    command = np.where(np.arange(STEPS) < STEPS // 2, there, back)
    command[:5] = 0.0
    servo = (ServoResponse, (6.0, 1.0))
    plain, loose = moved(command, servo), moved(command, servo, (MotionPlay, (width,)))
    assert np.abs(loose - plain).max() <= 0.5 * width + 1e-12
    assert loose[-1] == pytest.approx(plain[-1] + 0.5 * width, abs=1e-6)


def test_limits_hold() -> None:
    limited = moved(step(1.0), (ServoResponse, (8.0, 1.0)), (SpeedLimit, (0.7,)))
    assert np.diff(limited).max() / H <= 0.7 + 1e-9
    pulled = moved(step(1.0), (ServoResponse, (4.0, 1.0)), (DriveLimit, (0.05,)))
    terminal = 2.0 * np.pi * 4.0 * 0.05 / 2.0  # where braking equals the drive: ω e / 2ζ
    assert np.diff(pulled).max() / H <= terminal + 1e-6


def test_a_swing_ends_where_it_would_be_without_one() -> None:
    servo = (ServoResponse, (4.0, 0.9))
    swung = moved(step(0.3), servo, (Swing, (5.0, 0.2, 0.0)))
    assert swung.max() > 0.302
    assert swung[-1] == pytest.approx(moved(step(0.3), servo)[-1], abs=1e-4)


@pytest.mark.parametrize(("braking", "power"), [(0.005, 2.0), (0.03, 2.0), (0.03, 1.3), (0.01, 3.0)])
def test_drag_brakes_as_small_steps_do(braking: float, power: float) -> None:
    """Oracle: the symplectic Euler rule, in steps of a hundredth."""
    omega, h, q, v, expected = 2.0 * np.pi * 5.0, H / 100, 0.0, 0.0, [0.0]
    s = np.clip((H * np.arange(STEPS) - 0.3) / 0.35, 0.0, 1.0)
    told = 1.2 * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    for goal in told:
        for _ in range(100):
            v += h * (omega**2 * (goal - q - braking * np.sign(v) * abs(v) ** power) - 1.6 * omega * v)
            q += h * v
        expected.append(q)
    found = moved(told, (ServoResponse, (5.0, 0.8)), (Drag, (braking, power)))
    np.testing.assert_allclose(found, expected, atol=5e-3)


@pytest.mark.parametrize("kind", [GravitySag, InertialCoupling])
@pytest.mark.parametrize("heavier", [-0.004, 0.02])
def test_one_compliance_yields_to_what_others_push_and_to_its_own_links_inertia(
    kind: type[MotionEffect], heavier: float
) -> None:
    """J q̈ = K (u − q) − D q̇ + τ with K = 1/k and J = K/ω² + M − M₀."""
    k, omega, ratio, M = 0.03, 2.0 * np.pi * 4.0, 0.5, 0.01
    pushed = 0.3 * np.sin(np.arange(STEPS) * H)[:, None]
    loads = JointDrive(H, step(0.5)[:, None], NONE, pushed, NONE + M + heavier, M, np.zeros(1), np.zeros(1))
    servo, found = ServoResponse(ARM, "joint2"), kind(ARM, "joint2")
    values = [[np.array([[omega / 2.0 / np.pi]]), np.array([[ratio]])], [np.array([[k]])]]
    J = 1.0 / k / omega**2 + heavier
    slower = np.sqrt(1.0 / k / omega**2 / J)
    own = [[np.array([[slower * omega / 2.0 / np.pi]]), np.array([[slower * ratio]])]]
    alone = drive(step(0.5) + k * pushed[:, 0])
    np.testing.assert_allclose(simulate([servo, found], values, loads), simulate([servo], own, alone), atol=1e-9)


def test_a_share_of_links_that_weigh_nothing_in_the_middle_is_refused() -> None:
    varies = 0.01 * np.sin(np.arange(STEPS))[:, None] ** 2
    loads = JointDrive(H, step(0.5)[:, None], NONE, NONE, varies, 1e-33, np.zeros(1), np.zeros(1))
    assert LinkInertia(ARM, "joint1").missing_excitation(loads) is not None


@pytest.mark.parametrize("share", [0.0, 0.02, 0.4, 3.0])
def test_what_swings_pushes_its_servo_back_as_two_masses_in_small_steps_do(share: float) -> None:
    """Oracle: both masses by the symplectic Euler rule, in steps of a sixtieth."""
    omega, braking, own, damping = 2.0 * np.pi * 4.0, 2.0 * 0.7 * 2.0 * np.pi * 4.0, 2.0 * np.pi * 5.0, 0.05
    q, v, y, w, expected, h = 0.0, 0.0, 0.0, 0.0, [0.0], H / 60
    for told in step(0.5):
        for _ in range(60):
            pull = own**2 * (y - q) + 2.0 * damping * own * (w - v)
            v += h * (omega**2 * (told - q) - braking * v + share * pull)
            w -= h * pull
            q, y = q + h * v, y + h * w
        expected.append(y)
    found = moved(step(0.5), (ServoResponse, (4.0, 0.7)), (Swing, (5.0, 0.05, share)))
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_a_matrix_of_a_step_is_made_once_for_all_steps_that_are_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """And a load that varies is that of each step: one that varies by nothing a reading shows moves the link alike."""
    made: list[int] = []

    def counted(stiffness: Array, *others: Any) -> Array:
        made.append(stiffness.size)
        return np.asarray(two_masses(stiffness, *others))

    monkeypatch.setattr(simulation, "two_masses", counted)
    effects = (ServoResponse, LinkInertia, Swing)
    values = [[np.array([[value]]) for value in of] for of in ((4.0, 0.7), (0.4,), (5.0, 0.05, 0.4))]
    alike, varying = drive(step(0.5)), 1.0 + 1e-12 * np.arange(STEPS)[:, None]
    every = replace(alike, inertia=varying)
    one, all_steps = (simulate([of(ARM, "joint2") for of in effects], values, at) for at in (alike, every))
    assert made == [1, STEPS]
    np.testing.assert_allclose(one, all_steps, atol=1e-9)


@pytest.mark.parametrize("kind", MOTION_EFFECTS, ids=lambda kind: kind.id)
def test_every_effect_says_what_it_is_and_acts(kind: type[MotionEffect]) -> None:
    effect = kind(ARM, "joint2")
    assert tuple(EffectRef.parse(effect.name)) == (kind.id, "joint2")
    assert all((kind.about.cause, kind.about.formula, kind.about.source, kind.about.claim))
    for parameter in kind.parameters:
        assert parameter.si > 0.0
        assert parameter.scan
        assert all(parameter.lower <= value <= parameter.upper for value in (parameter.typical, *parameter.scan))
    rng = np.random.default_rng(0)
    command = np.cumsum(0.02 * rng.normal(size=STEPS)) + step(0.6)
    loads = 0.5 * np.sin(np.arange(STEPS) / 40.0)[:, None]
    bears = JointDrive(H, command[:, None], loads, loads, 1.0 + loads, 1.0, command[:1], np.zeros(1))
    servo, typical = ServoResponse(ARM, "joint2"), [np.array([[p.typical]]) for p in kind.parameters]
    response = [np.array([[4.0]]), np.array([[0.7]])]
    plain = simulate([servo], [response], bears)
    with_it = simulate([servo, effect], [response, typical], bears)
    assert kind is ServoResponse or np.abs(with_it - plain).max() > 1e-4


def test_offset_and_sets_of_parameters_are_simulated_apart() -> None:
    values = [[np.array([[3.0], [6.0]]), np.array([[0.5], [1.0]])], [np.array([[0.1], [0.1]])]]
    kinds = [ServoResponse(ARM, "joint1"), RestOffset(ARM, "joint1")]
    both = simulate(kinds, values, drive(step(0.2), 0.1))
    np.testing.assert_allclose(both[:, 0, 0], moved(step(0.2), (ServoResponse, (3.0, 0.5))) + 0.1, atol=1e-12)
    np.testing.assert_allclose(both[:, 1, 0], moved(step(0.2), (ServoResponse, (6.0, 1.0))) + 0.1, atol=1e-12)


def test_loads_at_rest_are_gravitys_and_a_joint_does_not_push_itself() -> None:
    rng = np.random.default_rng(1)
    q = np.repeat(rng.uniform(-0.8, 0.8, (3, 1, 5)), 6, axis=1)
    found, chain = joint_loads(ARM, q, 0.03), chain_of(ARM)
    for row in range(3):
        expected = joint_torques(chain, chain.gravity, q[row, 0].tolist(), 0.0)
        np.testing.assert_allclose(found.gravity[row, 2], expected, atol=1e-12)
    np.testing.assert_allclose(found.reaction, 0.0, atol=1e-9)
    t = 0.01 * np.arange(40)
    for joint in range(5):
        q = np.tile(rng.uniform(-0.5, 0.5, 5), (1, 40, 1))
        q[0, :, joint] += 0.3 * np.sin(6.0 * t)
        alone = joint_loads(ARM, q, 0.01)
        inner = slice(3, -3)
        own = np.abs(alone.inertia[0, inner, joint] * 0.3 * 36.0).max()
        assert np.abs(alone.reaction[0, inner, joint]).max() <= 0.01 * own + 1e-6


FRAME = 4
FINE = 16
FROM_COARSE = {
    "saturated drive": (DriveLimit, (0.06,), 0.1),
    "profile": (AccelerationLimit, (9.0,), 0.02),
    "friction that falls with speed": (StribeckFriction, (0.02, 0.2), 0.15),
    "swing": (Swing, (4.5, 0.1, 0.3), 0.001),
    "lead": (VelocityFeedforward, (0.05,), 0.001),
}
"""Effect, values, and how far (deg) steps of 8 ms may be from sixteenths of them at worst, of moves of 60°."""


@pytest.mark.parametrize("name", FROM_COARSE)
def test_the_length_of_a_step_hardly_matters(name: str) -> None:
    """Estimates took up the error of the first order: half a step of dead time for friction, 5 % of a drive limit."""
    kind, p, within = FROM_COARSE[name]
    rng = np.random.default_rng(2)
    goals = np.repeat(np.cumsum(rng.choice([-0.35, 0.0, 0.35], STEPS // 20)), 20)
    told = np.convolve(np.pad(goals, (8, 0), mode="edge"), np.ones(9) / 9.0, mode="valid")[::FRAME]
    effects = [ServoResponse(ARM, "joint2"), kind(ARM, "joint2")]
    values = [[np.array([[value]]) for value in own] for own in ((4.0, 0.8), p)]
    found = []
    for split in (1, FINE):
        command = np.repeat(told, FRAME * split)[:, None]
        none, at = np.zeros_like(command), np.full(1, told[0])
        along = JointDrive(H / split, command, none, none, none + 1.0, 1.0, at, np.zeros(1))
        found.append(simulate(effects, values, along)[:: FRAME * split, 0, 0])
    away = np.degrees(np.abs(found[0] - found[1]).max())
    assert away < within
