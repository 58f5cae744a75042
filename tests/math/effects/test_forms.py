"""Forms of effects, the point at which a link bends."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import lrm_ident as lrm
from lrm_math.arm.arm import Arm
from lrm_math.effects import CATALOGUE, FREE_FORMS, Effect, EffectRef, effect_of, effects_at, variants
from lrm_math.effects.compliance import LateralCompliance
from lrm_math.effects.curves import cubic_b_splines, spline_count
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.conftest import EXAMPLE
from validation.hidden_effects.data import ARM_FILE
from validation.synthetic import GroundTruth, HingedLink, load_arm, measure


def some_poses(arm: Arm, count: int = 12) -> Poses:
    rng = np.random.default_rng(1)
    number = np.arange(count)
    poses = poses_of(rng.uniform(-1.5, 1.5, (count, arm.dof)), 0.05)
    return replace(poses, t=60.0 * number, running=20.0 * number)


def with_form(arm: Arm, name: str) -> Model:
    """The lab arm's springs and one form, of a tenth of its typical size."""
    effects = (*effects_at(arm, "compliance"), *effects_at(arm, "lateral_compliance"), *effects_at(arm, name))
    model = model_of(arm, effects)
    return model.with_values([0.1 * p.typical for p in model.parameters])


@pytest.mark.parametrize("kind", FREE_FORMS, ids=lambda kind: kind.id)
def test_a_form_explains_itself_and_refines_effects_of_the_catalogue(lab: Arm, kind: type[Effect]) -> None:
    plain = {each.id: each for each in CATALOGUE}
    assert kind.variant_of
    assert kind.about.cause.endswith(".")
    for place in kind.places(lab):
        effect = kind(lab, place)
        causes = (EffectRef.parse(name) for name in variants(effect))
        assert any(at in plain[name].places(lab) for name, at in causes)
        assert all(parameter.name.endswith("_" + parameter.unit) for parameter in effect.parameters)
        effect.about.claimed_with(place, {p.name: "x" for p in effect.parameters})


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["bending_ends@link2", "torque_curve@joint3", "angle_curve@joint2",
     "coupling_curve@joint3<-joint2", "drift_curve@joint2", "drift_curve@base", "drift_curve@frame", "base_curve@base",
     "bearing_curve@link2", "friction_curve@joint3", "cable_curve@joint2+joint3"],
)  # fmt: skip
def test_derivatives_of_forms(lab: Arm, name: str) -> None:
    model, poses = with_form(lab, name), some_poses(lab)
    J = parameter_jacobian(solve_equilibrium(model, poses, tolerance=1e-14))
    for j, (key, parameter) in enumerate(zip(model.keys, model.parameters, strict=True)):
        if effect_of(key) == name:
            step = 1e-4 * parameter.typical * (np.arange(len(model.keys)) == j)
            tcp = [
                solve_equilibrium(model.with_values(model.values + s), poses, tolerance=1e-14).tcp
                for s in (step, -step)
            ]
            difference = (tcp[0] - tcp[1]) / (2e-4 * parameter.typical)
            assert np.abs(J[:, :, j] - difference).max() <= 1e-6 * np.abs(difference).max() + 1e-10, key


@given(st.floats(-100.0, 100.0), st.floats(30.0, 720.0))
def test_b_splines_are_a_partition_of_unity(at: float, span: float) -> None:
    lower, upper = np.radians([at - span / 3, at + 2 * span / 3])
    angles = np.linspace(lower, upper, 50)
    splines = cubic_b_splines(angles, lower, upper, np.radians(20.0))
    assert len(splines) == spline_count(lower, upper, np.radians(20.0))
    np.testing.assert_allclose(sum(splines), 1.0, atol=1e-12)
    assert all(np.min(spline) >= 0.0 for spline in splines)


def test_a_link_that_bends_at_its_ends_has_the_same_zero_pose(lab: Arm) -> None:
    poses, bending = some_poses(lab), effects_at(lab, "bending_ends")
    plain = solve_equilibrium(model_of(lab, effects_at(lab, "compliance")), poses).tcp
    rigid_ends = solve_equilibrium(model_of(lab, (*effects_at(lab, "compliance"), *bending)), poses).tcp
    np.testing.assert_allclose(rigid_ends, plain, atol=1e-12)


def test_springs_at_both_ends_and_the_middle_stand_for_a_bend_anywhere(lab: Arm) -> None:
    """A uniform beam, softness k along the link, is Simpson's rule over the three hinges: a sixth, two thirds, a sixth.

    Beside it: a bend of the same total softness at the middle only; they differ, and the beam's end shifts more.
    """
    poses, total = some_poses(lab), 0.03
    names = ("lateral_compliance@link2", "bending_ends@link2")
    model = model_of(lab, [effect for name in names for effect in effects_at(lab, name)])

    def moved(near: float, middle: float, far: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        weights = {"near": near, "far": far}
        values = [
            total * next((w for end, w in weights.items() if f"k_{end}_" in key), middle if "lateral" in key else 0.0)
            for key in model.keys
        ]
        rigid = solve_equilibrium(model.with_values(np.zeros(len(values))), poses).tcp
        return np.asarray(solve_equilibrium(model.with_values(values), poses).tcp - rigid)

    beam = moved(1 / 6, 2 / 3, 1 / 6)
    pieces = [moved(1.0, 0.0, 0.0) / 6, 2 * moved(0.0, 1.0, 0.0) / 3, moved(0.0, 0.0, 1.0) / 6]
    np.testing.assert_allclose(beam, sum(pieces), atol=0.1 * np.abs(beam).max())
    assert np.abs(beam - moved(0.0, 1.0, 0.0)).max() > 1e-5


@pytest.mark.parametrize("kind", [*CATALOGUE, *FREE_FORMS], ids=lambda kind: kind.id)
def test_an_effect_at_a_pose_does_not_depend_on_which_other_poses_are_taken(lab: Arm, kind: type[Effect]) -> None:
    """So that held-out poses are predicted by what was fitted: sessions and temperatures count from the whole data."""
    poses, rng = some_poses(lab), np.random.default_rng(3)
    session = np.repeat([4.0, 2.0, 9.0], 4)
    poses = replace(poses, session=session, temperature=rng.uniform(20.0, 40.0, 12))
    rows = np.array([5, 6, 9, 11])
    for place in kind.places(lab):
        effect = kind(lab, place)
        p = [parameter.fixed or 0.4 * parameter.typical for parameter in effect.parameters]
        tau = tuple(rng.normal(0.0, 0.3, 12) for _ in effect.load_slots)
        whole = effect.amounts(poses, tau, p)
        part = effect.amounts(poses.take(rows), tuple(load[rows] for load in tau), p)
        for one, other in zip(whole, part, strict=True):
            np.testing.assert_allclose(np.broadcast_to(one, 12)[rows], np.broadcast_to(other, 4), atol=1e-15)


K_X, K_Y = 0.02, 0.01
LENGTH_M = {2: 0.1036, 4: 0.1078}
"""By link of the lab's arm."""


def bent_poses(arm: Arm, count: int = 12) -> Poses:
    return poses_of(np.random.default_rng(1).uniform(-1.5, 1.5, (count, arm.dof)), 0.05)


def bending(arm: Arm, link: int, s: float) -> Model:
    return model_of(arm, effects_at(arm, f"lateral_compliance@link{link}")).with_values([K_X, K_Y, s])


@pytest.mark.long
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from([2, 4]), st.floats(0.0, 1.0))
def test_it_moves_the_tip_as_one_hinge_of_the_independent_generator(lab: Arm, link: int, s: float) -> None:
    """To first order: what differs is at most 1 % of what it moves."""
    poses = bent_poses(lab)
    ours = solve_equilibrium(bending(lab, link, s), poses).tcp - solve_equilibrium(model_of(lab, ()), poses).tcp
    described = load_arm(ARM_FILE)
    rigid = GroundTruth.nominal(described)
    hinge = HingedLink(link, (1.0 - s) * LENGTH_M[link], (K_X, K_Y))
    bent = GroundTruth(rigid.deviations, rigid.displacements, 0.0, rigid.joint_compliance_rad_per_nm, (hinge,))
    theirs = measure(described, bent, poses.q, 0.05) - measure(described, rigid, poses.q, 0.05)
    assert np.abs(theirs).max() > 3e-4
    np.testing.assert_allclose(ours, theirs, atol=0.01 * np.abs(theirs).max())


@pytest.mark.parametrize("s", [0.0, 0.25, 0.5, 0.8, 1.0])
def test_the_derivative_by_the_point_is_that_of_the_equilibrium(lab: Arm, s: float) -> None:
    poses, h = bent_poses(lab), 1e-4
    J = parameter_jacobian(solve_equilibrium(bending(lab, 2, s), poses, tolerance=1e-14))
    up, down = (solve_equilibrium(bending(lab, 2, s + side), poses, tolerance=1e-14).tcp for side in (h, -h))
    slope = (up - down) / (2.0 * h)
    assert np.abs(slope).max() > 1e-4
    np.testing.assert_allclose(J[:, :, 2], slope, atol=1e-5 * np.abs(slope).max())


def test_at_the_middle_only_the_middle_moves(lab: Arm) -> None:
    effect = LateralCompliance(lab, "link2")
    assert effect.compliances((K_X, K_Y, 0.5)) == (K_X, K_Y, 0.0, 0.0, 0.0, 0.0)
    assert effect.compliances((K_X, K_Y, 0.0)) == (0.0, 0.0, K_X, K_Y, 0.0, 0.0)
    assert effect.compliances((K_X, K_Y, 1.0)) == (0.0, 0.0, 0.0, 0.0, K_X, K_Y)


@pytest.mark.long
def test_a_file_from_before_bends_at_the_middle(tmp_path: Path) -> None:
    """Its parameters, and those in its history, do not state the point."""
    data = lrm.load(EXAMPLE)
    study = lrm.Study.of(data).fit().add("lateral_compliance@link2")
    now, before = tmp_path / "now.toml", tmp_path / "before.toml"
    study.save(now)
    lines = now.read_text().splitlines(keepends=True)
    stated = [line for line in lines if "link2.s_ratio" in line]
    assert len(stated) >= 2, "in the parameters and in the history"
    before.write_text("".join(line for line in lines if line not in stated))
    old = lrm.load_model(before)
    key = "lateral_compliance.link2.s_ratio"
    assert old.value(key) == 0.5
    at_middle = lrm.load_model(now).with_values_of([key], [0.5])
    expected, found = (solve_equilibrium(model, data.poses).tcp for model in (at_middle, old))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert lrm.read_study(before, EXAMPLE).model.value(key) == 0.5


def test_a_claim_says_the_sign_of_an_estimate_in_words(lab: Arm) -> None:
    """A joint that stops apart by a negative angle meant nothing to its owner."""
    gain = next(kind for kind in CATALOGUE if kind.id == "servo_gain")(lab, "joint1")
    estimates = {"g_plus_rad_per_rad": "-2.4 ± 0.1 %", "g_minus_rad_per_rad": "0.3 ± 0.1 %"}
    claim = gain.about.claimed_with("joint 1", estimates)
    assert claim == "joint 1 turns 2.4 ± 0.1 % too little above zero and 0.3 ± 0.1 % too far below"
