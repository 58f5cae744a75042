"""The compiled kernel against the Python code that knows nothing of it, and under sanitizers."""

from __future__ import annotations

import ctypes
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, reject
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, constant, effects_at
from lrm_math.effects.compliance import Spring
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.targets import Kind, kind_of, slot_of
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import CalibratedArm, equivalent_arm
from lrm_math.ik.goal import IkQuery, pose
from lrm_math.ik.kernel import shared_library
from lrm_math.ik.kernel.kernel_model import KernelModel, packed, with_laws
from lrm_math.ik.kernel.laws import KERNEL_LAWS, kernel_laws
from lrm_math.ik.kernel.shared_library import KernelArm
from lrm_math.ik.packed_arm import PackedArm
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.pieper import pieper_form
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.kinematics.screw_axes import screw_axes_of
from lrm_math.model.deployed_model import COMPENSATED
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.joint_errors import JointErrorModel
from lrm_math.model.model import Model, model_of
from tests.soak import sanitised
from tests.support.link_matrices import link_matrices
from tests.support.random_arms import arms, random_arm
from tests.support.sweep import examples

FLEXIBLE = ("offsets", "compliance", "base_compliance", "lateral_compliance")
NONLINEAR = (
    *("servo_gain", "common_gain", "eccentricity", "backlash", "nonlinear_stiffness", "hysteresis", "cable_spring"),
    "coupling",
)
ON_JOINTS = ("compliance", *NONLINEAR)


def random_model(arm: Arm, names: tuple[str, ...], seed: int, size: float = 0.3) -> Model:
    """An arm with some effects of random size."""
    model = model_of(arm, [effect for name in names for effect in effects_at(arm, name)])
    share = np.random.default_rng(seed).uniform(-1.0, 1.0, len(model.keys))
    free = np.array([p.fixed is None for p in model.parameters])
    amounts = size * np.where([p.lower == 0.0 for p in model.parameters], np.abs(share), share)
    return model.with_values(np.where(free, amounts * [p.typical for p in model.parameters], model.values))


def flat(model: Model, payload: float) -> KernelModel:
    """The packed model, without closed form and library."""
    laws, joints, whole = JointErrorModel(model), model.arm.joints, PackedArm(model)
    moments = laws.moving.moments(model.weights(payload))
    arm = packed(laws.moving, moments, model.binding.reach, [j.lower for j in joints], [j.upper for j in joints])
    return with_laws(
        arm.with_springs(laws.constants, laws.compliances), kernel_laws(model) if whole.complete else (), whole.complete
    )


def moving(model: Model, slots: tuple[float | Array, ...], count: int) -> Array:
    """(K, V), amounts of the moving slots."""
    return np.stack([np.broadcast_to(slots[k], count) for k in JointErrorModel(model).moving.slots], axis=1)


@pytest.mark.slow
@examples(12, 25)
@given(arms, st.integers(0, 100), st.floats(0.0, 0.1))
def test_kinematics_and_loads_equal_those_of_the_chain(arm: Arm, seed: int, payload: float) -> None:
    model = random_model(arm, FLEXIBLE, seed, 0.03)
    poses = poses_of(np.random.default_rng(seed).uniform(-1.7, 1.7, (3, arm.dof)), payload)
    equilibrium = solve_equilibrium(model, poses, tolerance=1e-14)
    slots, kernel = moving(model, equilibrium.slots, 3), flat(model, payload)
    tcp, tau = kernel.forward(slots)
    np.testing.assert_allclose(tcp, frames(model.chain, equilibrium.slots, 3)[:, -1], atol=1e-12)
    np.testing.assert_allclose(kernel.frames(slots), frames(model.chain, equilibrium.slots, 3), atol=1e-12)
    np.testing.assert_allclose(tau, equilibrium.loads_on(JointErrorModel(model).moving.slots.tolist()), atol=1e-11)


def hayati_arm(beta: float) -> Arm:
    """The laboratory arm, whose second and third axes are nearly parallel and drawn at an angle beta (Hayati 1983)."""
    arm = load_arm("lrm-lab")
    links = list(arm.joints)
    links[1] = replace(links[1], alpha=0.01, beta=beta)
    return replace(arm, joints=tuple(links))


def test_a_drawn_hayati_angle_is_in_the_kernel_and_in_its_seeds() -> None:
    """Frames against a product of matrices; from the equivalent arm, without the angle, every branch leads there."""
    arm = hayati_arm(0.03)
    model = model_of(arm, effects_at(arm, "offsets"), {"offsets.joint2.beta_rad": 0.007})
    q = np.array([0.3, -0.5, 0.9, 0.4, -0.7, 0.2])
    tool = link_matrices(hayati_arm(0.037), q)[-1]
    kernel, home = flat(model, 0.0), JointErrorModel(model).constants
    np.testing.assert_allclose(kernel.forward((home + q)[None])[0][0], tool, atol=1e-12)
    assert pieper_form(screw_axes_of(equivalent_arm(model))) is not None
    solver = CalibratedSolver.of(model)
    found = solver.arm.branches(IkQuery(pose(tool[:3, 3], tool[:3, :3])))
    assert any(np.abs(np.array(command.q) - q).max() < 1e-8 for command in found.within)
    for command in found.within:
        np.testing.assert_allclose(kernel.forward((home + command.q)[None])[0][0], tool, atol=1e-9)


@pytest.mark.parametrize("name", ["lrm-rover", "lrm-lab"])
def test_load_derivatives_match_finite_differences(name: str) -> None:
    """On arms some of whose joints count bodies that they do not move."""
    model = random_model(load_arm(name), FLEXIBLE, 1)
    assert chain_of(model.arm).counted != chain_of(model.arm).moved
    kernel = flat(model, 0.08)
    here, h = np.random.default_rng(2).uniform(-1.5, 1.5, kernel.slots), 1e-5
    derivatives = kernel.load_derivatives(here)
    for v in range(kernel.slots):
        step = h * (np.arange(kernel.slots) == v)
        up, down = (kernel.forward((here + way * step)[None])[1][0] for way in (1, -1))
        np.testing.assert_allclose(derivatives[:, v], (up - down) / (2 * h), atol=2e-8)


def test_a_slot_that_slides_is_as_in_the_chain() -> None:
    """A joint with play along its axis, and a load along it."""
    arm = load_arm("lrm-lab")
    effects = (*effects_at(arm, "compliance"), *effects_at(arm, "axial_play@joint3"))
    model = model_of(arm, effects, {"axial_play.joint3.b_mm": 0.004})
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 6))
    equilibrium = solve_equilibrium(model, poses_of(q, 0.05), tolerance=1e-14)
    kernel = flat(model, 0.05)
    assert (np.array(JointErrorModel(model).moving.axes) >= 3).sum() == 1
    slots = moving(model, equilibrium.slots, 4)
    tcp, tau = kernel.forward(slots)
    np.testing.assert_allclose(tcp, frames(model.chain, equilibrium.slots, 4)[:, -1], atol=1e-12)
    np.testing.assert_allclose(tau, equilibrium.loads_on(JointErrorModel(model).moving.slots.tolist()), atol=1e-11)
    v = int(np.flatnonzero(JointErrorModel(model).moving.axes >= 3)[0])
    assert np.abs(tau[:, v]).min() > 0.1
    moved = slots.copy()
    moved[:, v] += 1e-3
    np.testing.assert_allclose(np.linalg.norm(kernel.forward(moved)[0][:, :3, 3] - tcp[:, :3, 3], axis=1), 1e-3)
    h = 1e-5
    for row in slots:
        derivatives = kernel.load_derivatives(row)
        for u in range(kernel.slots):
            step = h * (np.arange(kernel.slots) == u)
            up, down = (kernel.forward((row + way * step)[None])[1][0] for way in (1, -1))
            np.testing.assert_allclose(derivatives[:, u], (up - down) / (2 * h), atol=2e-8)


def test_every_law_of_the_kernel_is_one_of_the_catalogue() -> None:
    """And every effect of the catalogue that only changes joint angles as the robot moves has a law there."""
    arm = load_arm("lrm-rover")
    theta = {f"{joint}.theta" for joint in arm.joint_names}
    needs = set()
    for kind in CATALOGUE:
        effect = effects_at(arm, kind.id)[0]
        on_joints = (
            {slot_of(target) for target in effect.targets} if kind_of(effect) in (Kind.MOTION, Kind.LOAD) else set()
        )
        if set(kind.depends_on) <= COMPENSATED and on_joints and on_joints <= theta:
            needs |= set() if constant(effect) or isinstance(effect, Spring) else {kind}
    forgotten = ", ".join(sorted(kind.id for kind in needs - set(KERNEL_LAWS)))
    assert set(KERNEL_LAWS) == needs, f"without a law in kernel/laws.py and ik_kernel.c: {forgotten}"
    assert set(KERNEL_LAWS.values()) == set(range(len(KERNEL_LAWS) - 1))  # a gain of all servos is one of each


@pytest.mark.slow
@pytest.mark.parametrize("name", NONLINEAR)
@examples(10, 20)
@given(seed=st.integers(0, 10_000))
def test_laws_equal_the_effects_of_the_catalogue(name: str, seed: int) -> None:
    """True joint angles at rest under any commands, sides of arrival and loads."""
    arm, rng = load_arm("lrm-rover"), np.random.default_rng(seed)
    model = random_model(arm, ("compliance", name), seed, 1.5)
    payload = rng.uniform(0.0, 0.3)
    assert PackedArm(model).complete
    q, side = rng.uniform(-1.7, 1.7, (5, 6)), rng.integers(-1, 2, (5, 6))
    try:
        equilibrium = solve_equilibrium(model, Poses(q, np.full(5, payload), side.astype(float)), tolerance=1e-14)
    except NoEquilibrium:  # a random arm too soft to hold itself
        reject()
    expected = moving(model, equilibrium.slots, 5)
    slots, _, iterations = flat(model, payload).settle(q, side, expected + 0.01, 1e-14)
    assert (iterations > 0).all()
    np.testing.assert_allclose(slots, expected, atol=1e-12)


@examples(5, 10)
@given(seed=st.integers(0, 10_000), edge=st.floats(0.01, 0.6))
def test_a_law_that_is_held_beyond_its_range_is_held_in_the_kernel(seed: int, edge: float) -> None:
    arm, rng = load_arm("lrm-rover"), np.random.default_rng(seed)
    model = random_model(arm, ("compliance", "nonlinear_stiffness"), seed, 1.5)
    load = {f"{joint}.theta": (-edge, 0.7 * edge) for joint in arm.joint_names}
    model = replace(model, within=MeasuredRange(((-0.1, 0.1),) * 6, (0.0, 0.0), load))
    assert PackedArm(model).complete
    q = rng.uniform(-1.7, 1.7, (5, 6))
    equilibrium = solve_equilibrium(model, poses_of(q, 0.2), tolerance=1e-14)
    expected = moving(model, equilibrium.slots, 5)
    slots, _, iterations = flat(model, 0.2).settle(q, np.zeros((5, 6), dtype=int), expected + 0.01, 1e-14)
    assert (iterations > 0).all()
    np.testing.assert_allclose(slots, expected, atol=1e-12)


@pytest.mark.long
@examples(5, 10)
@given(seed=st.integers(0, 10_000), payload=st.floats(0.0, 0.1))
def test_equilibria_and_commands_are_those_of_the_model(seed: int, payload: float) -> None:
    """Takes every law at once, links that bend, and sides of arrival."""
    model = random_model(load_arm("lrm-rover"), (*ON_JOINTS, *FLEXIBLE[2:]), seed, 0.15)
    laws, kernel, rng = JointErrorModel(model), flat(model, payload), np.random.default_rng(seed)
    q, side = rng.uniform(-1.5, 1.5, (6, 6)), rng.choice([-1.0, 0.0, 1.0], (6, 6))
    equilibrium = solve_equilibrium(model, Poses(q, np.full(6, payload), side), tolerance=1e-13)
    start = np.tile(laws.constants, (6, 1))
    start[:, laws.moving.joints] += q
    slots, tcp, iterations = kernel.settle(q, side, start, 1e-13)
    assert (iterations > 0).all()
    np.testing.assert_allclose(slots, moving(model, equilibrium.slots, 6), atol=1e-11)
    np.testing.assert_allclose(tcp[:, 9:], equilibrium.true_tcp, atol=1e-11)
    _, tau = kernel.forward(slots)
    for frame, row, command in zip(tcp, slots, q, strict=True):
        state = kernel.newton(pose(frame[9:], frame[:9].reshape(3, 3).T), row, command.tolist())
        found = state[2].at[0]
        again, _, _ = kernel.settle(np.array([found.q[:6]]), np.array([found.side[:6]]), row[None], 1e-13)
        np.testing.assert_allclose(again[0], row, atol=1e-10)
    np.testing.assert_allclose(
        laws.command(Poses(np.zeros_like(q), np.full(6, payload), side), tau, slots), q, atol=1e-10
    )


def test_an_arm_beyond_the_fixed_maxima_is_one_clear_error() -> None:
    with pytest.raises(LrmError, match=r"17 joints; the kernel .* has room for 16"):
        flat(model_of(random_arm(0, 17), ()), 0.0)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"joint": [48]}, "joint has numbers from 48 to 48; packed wrongly"),
        ({"counted": [-1]}, "counted has numbers"),
        ({"inboard": [0, 10**6]}, "inboard has numbers"),
        ({"axis": [6]}, "axis has numbers"),
        ({"spring_load": [99]}, "spring_load has numbers"),
        ({"law": [8]}, "law has numbers"),
        ({"law_joint": [6]}, "law_joint has numbers"),
        ({"moment": [np.nan]}, "moment has a number that is not finite"),
        ({"zero": [np.inf]}, "zero has a number that is not finite"),
        ({"lower": [0.0] * 17}, "17 numbers in lower; the kernel .* has room for 16"),
    ],
)
def test_a_model_packed_wrongly_is_one_clear_error(wrong: dict[str, list[float]], says: str) -> None:
    """Corrupts every array that the kernel finds its way by."""
    arm = flat(random_model(load_arm("lrm-rover"), ON_JOINTS, 0), 0.0)
    with pytest.raises(LrmError, match=says):
        arm.with_(**wrong)


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(value: float) -> None:
    arm = load_arm("lrm-lab")
    broken = replace(arm, joints=(replace(arm.joints[0], a=value), *arm.joints[1:]))
    with pytest.raises(LrmError):
        CalibratedArm(model_of(broken, ())).kernel(0.0)


def test_a_missing_stale_or_foreign_library_is_one_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LrmError, match=r"is missing; run `make setup`"):
        shared_library.loaded(tmp_path / "none.so")
    (tmp_path / "text.so").write_text("no library")
    with pytest.raises(LrmError, match="no kernel for this machine"):
        shared_library.loaded(tmp_path / "text.so")
    edited = tmp_path / "ik_kernel.c"
    edited.write_bytes(shared_library.SOURCE.read_bytes() + b"/* edited */\n")
    copied = shutil.copy(shared_library.BUILT, tmp_path / "copy.so")
    monkeypatch.setattr(shared_library, "SOURCE", edited)
    with pytest.raises(LrmError, match="built from another version"):
        shared_library.loaded(Path(copied))
    monkeypatch.undo()

    class Longer(KernelArm):
        _fields_ = [("more", ctypes.c_int)]

    monkeypatch.setattr(shared_library, "KernelArm", Longer)
    with pytest.raises(LrmError, match="built from another version"):
        shared_library.loaded(Path(copied))


def test_a_settled_command_too_soft_is_not_at_rest() -> None:
    """The rule of `equilibrium`: deflections above 0.5 rad are refused."""
    arm = load_arm("lrm-rover")
    model = model_of(arm, effects_at(arm, "compliance"), {"compliance.joint2.k_rad_per_Nm": 3.0})
    context = CalibratedSolver.of(model).arm
    equilibrium = context.equilibria(0.5, np.array([[0.0, 1.5, 0.0, 0.0, 0.0, 0.0]]))
    assert len(equilibrium.rows) == 0


@pytest.mark.slow
@pytest.mark.skipif(not sanitised.runtimes(), reason="the C compiler has no sanitizers")
def test_the_ik_fuzz_reads_and_writes_no_memory_but_its_own() -> None:
    done = sanitised.run(queries=25, seed=3, capture=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "25 queries, seed 3, " in done.stdout
    assert "0 violations" in done.stdout
