"""What is put into real measurements is the motion of the effect, and nothing else."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.write import measurements_csv, write_with_metadata
from lrm_ident.data.measurements import Measurements
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import Effect, effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation.real_data import implanted
from validation.real_data.implant import DRAWN, LEAST, MOST, NEAR, RealArm, drawn, motion
from validation.real_data.implanted import Found, examine

pytestmark = pytest.mark.long
ARM = load_arm("ur5")


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> RealArm:
    """A UR5 with 0.1 mm of noise at 80 poses; `auto` is not run."""
    rng, path = np.random.default_rng(4), tmp_path_factory.mktemp("real") / "data.csv"
    poses = poses_of(np.radians(rng.uniform(-60.0, 60.0, (80, 6))))
    tip = solve_equilibrium(model_of(ARM, ()), poses).tcp
    measured = Measurements.of_tcp(poses, tip + rng.normal(0.0, 1e-4, tip.shape))
    write_with_metadata(path, measurements_csv(measured), "ur5", "made")
    data = lrm.load(path)
    fitted = lrm.Study.of(data).fit()
    return RealArm("ur5", data, fitted, fitted, ())


def turned_before(real: RealArm, angle: float, last: float) -> tuple[Effect, list[float], Array]:
    """Joint 1 stood at another angle (rad) until a pose: the effect, its values, and how the tip moves (m)."""
    (effect,) = effects_at(ARM, "change_point@joint1")
    values = [angle, last]
    return effect, values, motion(real.fitted.model, real.data.poses, effect, values)


def test_a_joint_that_stood_elsewhere_turns_the_tip_about_its_axis_and_only_then(real: RealArm) -> None:
    """The axis of joint 1 is that of the base, z, up to the offsets that the fit finds (0.1 mm)."""
    angle = 0.01
    _, _, moved = turned_before(real, angle, 30.0)
    model = model_of(ARM, ())
    x, y, z = solve_equilibrium(model, real.data.poses).tcp.T
    turned = np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z], axis=1)
    expected = np.where(np.arange(80)[:, None] < 30, turned - np.stack([x, y, z], axis=1), 0.0)
    (effect,) = effects_at(ARM, "change_point@joint1")
    np.testing.assert_allclose(motion(model, real.data.poses, effect, [angle, 30.0]), expected, atol=1e-12)
    np.testing.assert_allclose(moved, expected, atol=2e-5)
    assert not moved[30:].any()


@pytest.mark.parametrize("seed", range(len(DRAWN)))
def test_what_is_drawn_has_a_plausible_size_and_moves_the_tip_that_far(real: RealArm, seed: int) -> None:
    effect, values, moved = drawn(real, seed)
    np.testing.assert_array_equal(moved, motion(real.fitted.model, real.data.poses, effect, values))
    assert LEAST * (1.0 - NEAR) < error_stats(moved).rms / real.fit_rms < MOST * (1.0 + NEAR)
    for parameter, value in zip(effect.parameters, values, strict=True):
        assert parameter.lower <= value <= parameter.upper
        assert parameter.fixed is not None or abs(value) <= parameter.plausible.largest
    assert drawn(real, seed)[:2] == (effect, values)


def test_the_file_has_the_motion_beside_the_measurements_and_a_constant_one_is_absorbed(
    real: RealArm, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    always = turned_before(real, 0.001, 1000.0)
    monkeypatch.setattr(implanted, "drawn", lambda *_: always)
    found = examine({"ur5": real}, tmp_path, ("ur5", 0))
    assert found.absorbed
    assert math.isclose(found.raised, 1.0, abs_tol=1e-3)
    kept = lrm.load(tmp_path / "ur5-0.csv")
    np.testing.assert_allclose(kept.tcp - real.data.tcp, always[2], atol=2e-9)  # a file has six digits of a millimetre
    np.testing.assert_allclose(kept.poses.q, real.data.poses.q, atol=1e-10)


@pytest.mark.parametrize(
    ("steps", "forms", "terms", "reached", "false"),
    [
        (
            (("a@joint2",), ("b", "a@joint2")),
            ((), ()),
            ("empirical term", "indistinguishable cause"),
            "indistinguishable cause",
            (),
        ),
        ((("b",), ("a@joint2",)), ((), ()), ("identified cause", "candidate cause"), "candidate cause", ("b",)),
        ((("curve@joint1+joint2",),), (("b", "c"),), ("empirical term",), "a free curve there", ()),
        ((("curve@joint1+joint12",),), (("b", "c"),), ("empirical term",), "vanished", ()),
        ((("b@joint2",),), ((),), ("candidate cause",), "vanished", ()),
        ((), (), (), "vanished", ()),
    ],
)
def test_what_is_said_of_it_is_the_most_that_any_step_says(
    steps: tuple[tuple[str, ...], ...],
    forms: tuple[tuple[str, ...], ...],
    terms: tuple[str, ...],
    reached: str,
    false: tuple[str, ...],
) -> None:
    found = Found("a@joint2", 3.0, 2.0, steps=steps, forms=forms, terms=terms)
    assert found.reached == reached
    assert found.false == false
