"""Candidate poses keep their rules; designs keep what they promise: errors, power, and a file that can be measured."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from lrm_ident.data.measurement_file.commanded_poses import directions
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.data.measurement_file.number_table import numbers_of, read_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.candidate_poses import (
    ClearanceRules,
    candidate_grid,
    floor_above_table,
    lowest_point,
    parse_levels,
    violated_rules,
)
from lrm_ident.design.discrimination import TARGET_POWER, TEST_LEVEL, discrimination_of
from lrm_ident.design.pose_design import DesignProblem, PoseDesign, _distinct, _from_both_sides, design
from lrm_ident.design.pose_selection import select_poses
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.parameter_sets import TABLE_4_5, bounds_of, no_bounds, select_parameters
from lrm_ident.measuring.campaign.plan import load_plan
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.collision.scene import Scene, clearance
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.conftest import EXAMPLE
from tests.support.commands import run_command, stderr_of, stdout_of

MEASURED_LEVELS = "-100,0,100; joint2=-50,0,50; joint6=-50,0,50"
RIVALS = ("backlash@joint2", "nonlinear_stiffness@joint2")


def offered(arm: Arm, count: int = 400, loads: tuple[float, ...] = (0.0,)) -> Poses:
    q = candidate_grid(arm, parse_levels(arm, "4")).q
    rows = np.random.default_rng(0).choice(len(q), count, replace=False)
    return poses_of(np.tile(q[rows], (len(loads), 1)), np.repeat(loads, count))


def task(arm: Arm, rivals: tuple[str, ...] = (), **other: object) -> DesignProblem:
    effects = tuple(effect for name in rivals for effect in effects_at(arm, name))
    usual = DesignProblem(nominal_model(arm), TABLE_4_5, effects, 40, "O1", 3e-4, None, 4, 1, 0)
    return replace(usual, **other)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def separating(lab: Arm) -> PoseDesign:
    return design(task(lab, RIVALS), offered(lab))


def test_levels_in_words(lab: Arm) -> None:
    five = parse_levels(lab, "5; joint2=-50,0,50; joint6=2")
    assert np.degrees(five[0]) == pytest.approx([-100, -50, 0, 50, 100])
    assert np.degrees(five[1]) == pytest.approx([-50, 0, 50])
    assert np.degrees(five[5]) == pytest.approx([-100, 100])
    with pytest.raises(UnknownName, match="joint7"):
        parse_levels(lab, "joint7=3")
    for words in ("many", "-100,120", "", "2.5"):
        with pytest.raises(LrmError, match="joint 1"):
            parse_levels(lab, words)


@pytest.mark.parametrize("name", ["lab", "rover"])
def test_candidates_keep_clear(name: str, request: pytest.FixtureRequest) -> None:
    arm = cast(Arm, request.getfixturevalue(name))
    found = candidate_grid(arm, parse_levels(arm, "3; joint2=-50,0,50"), ClearanceRules(floor=0.02))
    assert 0 < len(found.q) < found.tried == 729
    assert clearance(Scene.of(arm), found.q).distance.min() >= 0.03
    tcp = solve_equilibrium(model_of(arm, ()), poses_of(found.q)).tcp
    assert tcp[:, 2].min() >= 0.02
    base = np.array([arm.base.x, arm.base.y, arm.base.z])
    assert np.linalg.norm(tcp - base, axis=1).min() >= 0.16
    assert not any(rows.any() for rows in violated_rules(arm, found.q, ClearanceRules(floor=0.02)).values())


def test_an_arm_without_shapes_keeps_its_tip_away_from_its_lines(lab: Arm) -> None:
    bare = replace(lab, shapes=type(lab.shapes)())
    found = candidate_grid(bare, parse_levels(bare, "3"))
    assert 0 < len(found.q) < 729
    assert list(found.rejected) == ["the TCP within 160 mm of an inner link"]


def test_rules_that_nothing_keeps_and_too_many_levels(lab: Arm) -> None:
    with pytest.raises(LrmError, match="none of 64"):
        candidate_grid(lab, parse_levels(lab, "2"), ClearanceRules(floor=2.0))
    with pytest.raises(LrmError, match="take --levels any"):
        candidate_grid(lab, parse_levels(lab, "12"))


def test_the_measured_poses_keep_the_distance_of_bodies(real: Measurements, lab: Arm) -> None:
    broken = violated_rules(lab, real.poses.q, ClearanceRules())
    assert not broken["bodies within 30 mm"].any()
    assert not broken["the TCP within 160 mm of an inner link"].any()


@pytest.mark.slow
def test_a_design_can_be_measured_as_it_stands(separating: PoseDesign) -> None:
    found = separating
    assert len(found.rows) == 40
    assert len(found.poses) == 44
    assert found.number.tolist() == list(range(1, 45))
    assert set(found.repeat_of.tolist()) <= set(found.number.tolist())
    assert np.count_nonzero(found.repeat_of != found.number) == 4
    for k, first in enumerate(found.repeat_of - 1):
        assert first <= k
        assert np.array_equal(found.poses.q[k], found.poses.q[first])
        assert found.poses.payload[k] == found.poses.payload[first]
        assert np.array_equal(found.poses.direction[k], found.poses.direction[first])  # type: ignore[index]
    assert {-1.0, 1.0} == set(np.unique(found.poses.direction))  # type: ignore[arg-type]


@pytest.mark.slow
def test_loads_are_changed_once_each(lab: Arm) -> None:
    found = design(task(lab, RIVALS), offered(lab, 200, (0.0, 0.0663)))
    assert np.all(np.diff(found.poses.payload) >= 0)
    assert len(np.unique(found.poses.payload)) == 2


@pytest.mark.slow
def test_designed_poses_tell_more_than_blind_ones(lab: Arm, separating: PoseDesign) -> None:
    plain = design(task(lab), offered(lab))
    assert plain.after.tcp < plain.random_after.tcp
    assert plain.observability.O1 > plain.random_baseline.O1
    assert plain.after.discrimination is None
    apart, blind = separating.after.discrimination, separating.random_after.discrimination
    assert apart.cosine < blind.cosine
    for ours, theirs in zip(apart.rivals, blind.rivals, strict=True):
        assert ours.detectable_size is not None
        assert theirs.detectable_size is None or ours.detectable_size < theirs.detectable_size
    assert plain.after.tcp <= separating.after.tcp


@pytest.mark.slow
def test_poses_at_hand_are_built_upon(lab: Arm) -> None:
    have = offered(lab, 60)
    some = design(task(lab, RIVALS, measured=have, count=10, first_number=61), offered(lab))
    more = design(task(lab, RIVALS, measured=have, count=30, first_number=61), offered(lab))
    assert some.number[0] == 61
    assert np.all(some.after.standard_errors < some.before.standard_errors)
    assert more.after.tcp < some.after.tcp < some.before.tcp
    np.testing.assert_allclose(more.before.standard_errors, some.before.standard_errors)


@pytest.mark.slow
def test_a_side_is_chosen_where_it_matters(lab: Arm) -> None:
    found = design(task(lab, ("hysteresis@joint2", "coupling@joint2<-joint3")), offered(lab, 200))
    sides = found.poses.direction[:, 1]  # type: ignore[index]
    assert min(np.count_nonzero(sides > 0), np.count_nonzero(sides < 0)) >= 15
    assert all(rival.power > 0.99 for rival in found.after.discrimination.rivals)


@pytest.mark.slow
def test_expected_errors_are_what_fits_scatter_by(lab: Arm) -> None:
    """Inject and refit: the TCP errs as far as promised, on average over the candidates."""
    poses = offered(lab)
    found = design(task(lab), poses)
    truth = replace(nominal_model(lab), free=TABLE_4_5)
    tcp, everywhere = solve_equilibrium(truth, found.poses).tcp, solve_equilibrium(truth, poses).tcp
    rng, away = np.random.default_rng(0), []
    for _ in range(25):
        seen = tcp + rng.normal(0, 3e-4, tcp.shape)
        data = Measurements.of_tcp(found.poses, seen, pose=found.number)
        fitted = fit(truth, data, no_bounds(truth.free)).model
        away.append(((solve_equilibrium(fitted, poses).tcp - everywhere) ** 2).sum(axis=1).mean())
    assert np.sqrt(np.mean(away)) * 1e3 == pytest.approx(found.after.tcp, rel=0.12)


def test_effects_of_the_size_named_are_found_as_often_as_said(lab: Arm) -> None:
    """Linear and simulated: the F test of an effect of the least size that is surely seen."""
    rng = np.random.default_rng(1)
    effects = effects_at(lab, "backlash@joint2") + effects_at(lab, "coupling@joint2<-joint3")
    fitted, one, other = (rng.normal(size=(60, k)) for k in (10, 1, 1))
    told = discrimination_of(effects, fitted, [one, other], noise=0.5).rivals[0]
    assert told.detectable_size is not None
    hits, draws = 0, 2000
    known, wide = np.concatenate([fitted, other], axis=1), np.concatenate([fitted, other, one], axis=1)
    for _ in range(draws):
        seen = told.detectable_size * one[:, 0] + rng.normal(0, 0.5, 60)
        left = [float(np.linalg.lstsq(columns, seen, rcond=None)[1][0]) for columns in (known, wide)]
        hits += (left[0] - left[1]) / (left[1] / (60 - 12)) > 7.194  # F(1, 48) at 1 %
    assert pytest.approx(0.01) == TEST_LEVEL
    assert hits / draws == pytest.approx(TARGET_POWER, abs=0.03)


@pytest.mark.slow
def test_rivals_that_nothing_can_tell_apart(lab: Arm) -> None:
    q = candidate_grid(lab, parse_levels(lab, MEASURED_LEVELS)).q
    with pytest.raises(LrmError, match="servo_gain@joint2 and eccentricity@joint2 apart"):
        design(task(lab, ("servo_gain@joint2", "eccentricity@joint2")), poses_of(q))
    with pytest.raises(LrmError, match="fitted already"):
        design(task(lab, ("compliance@joint2",)), offered(lab))
    with pytest.raises(LrmError, match="cannot show"):
        design(task(lab, ("session@joint2",)), offered(lab))
    with pytest.raises(LrmError, match=r"ask for at least 11 \(-n\)"):
        design(task(lab, RIVALS, count=10), offered(lab))


@pytest.mark.slow
def test_identification_on_chosen_real_poses(real: Measurements, lab: Arm) -> None:
    """Constrained sets identify physically; with bounds in the fit any set does."""
    model = nominal_model(lab)
    model = replace(model, free=select_parameters(model, "option1"))
    for seed in range(2):
        found = select_poses(model, real, 34, physical=True, seed=seed)
        free, bounded = found.fits
        assert not bounded.violated_bounds
        assert not free.violated_bounds
        assert found.observability.value("O1") <= found.o1_upper_bound
        assert bounded.error_rest is not None
        assert bounded.error_all.mean < 9e-3 < bounded.error_all.max
    limits = bounds_of(model, model.free)
    values = np.array([bounded.fit.model.value(key) for key in model.free])
    assert np.all((values >= limits.lower) & (values <= limits.upper))


def test_a_joint_at_its_limit_is_approached_from_within(tmp_path: Path) -> None:
    """The corners of the range among the candidates: half of the angles of the first joint, all of the second's."""
    path, arm = tmp_path / "next.csv", load_arm("two-joint")
    low, high = np.degrees([arm.joints[0].lower, arm.joints[0].upper])
    words = ["--levels", f"{low},-20,0,{high}; joint2=2", "-n", "6", "--repeats", "0", "--parameters", "compliance.*"]
    stdout_of("design", "two-joint", *words, "-o", path)
    poses, plan = load_poses(path, arm), load_plan(path, arm)
    assert [pose.approach for pose in plan.poses] == [tuple(row) for row in poses.direction.tolist()]
    beside = poses.q - poses.direction * np.radians(1.0)
    for joint, limits in enumerate(arm.joints):
        assert np.all((beside[:, joint] >= limits.lower) & (beside[:, joint] <= limits.upper))


def test_where_sides_matter_a_corner_of_the_range_is_one_candidate() -> None:
    arm = load_arm("two-joint")
    low, high = arm.joints[0].lower, arm.joints[0].upper
    sided = _distinct(_from_both_sides(arm, poses_of(np.array([[low, high], [low, 0.0], [0.1, 0.2]]))))
    assert sided.direction.tolist() == [[-1, 1], [-1, 1], [-1, -1], [1, 1], [-1, -1]]


@pytest.mark.slow
def test_the_commands_and_their_files(tmp_path: Path, lab: Arm) -> None:
    poses, figure = tmp_path / "next.csv", tmp_path / "why.svg"
    words = [
        "--levels", MEASURED_LEVELS, "--separate", ",".join(RIVALS), "-n", "30", "--loads-g", "0,66.3", "--parameters",
        "option1",
    ]  # fmt: skip
    said = stdout_of("design", "lrm-lab", *words, "-o", poses, "--json", tmp_path / "d.json", "--figure", figure)
    assert "Smallest size that is distinguished from all else" in said
    table = read_csv(poses, ["pose", "q1_deg", "payload_g", "approach1", "approach6", "repeat_of"])
    assert len(table.rows) == 35
    assert set(numbers_of(table, "approach1")) == {-1.0, 1.0}
    assert len(load_poses(poses, lab)) == 35
    assert len(read_csv(figure.with_suffix(".csv"), ["what", "unit", "with_these"]).rows) == 28 + 2
    told = json.loads((tmp_path / "d.json").read_text())
    assert told["schema"] == "lrm/design/2"
    assert [rival["effect"] for rival in told["with_these"]["separate"]] == list(RIVALS)
    assert [set(one) for one in told["limitations"]] == [{"kind", "joints", "numbers", "sentence"}]
    (tmp_path / "m.toml").write_text('schema = "lrm/model/1"\narm = "lrm-lab"\neffects = ["offsets", "compliance"]\n')
    stdout_of("predict", tmp_path / "m.toml", poses, "-o", tmp_path / "p.csv")
    more = tmp_path / "more.csv"
    stdout_of("design", "lrm-lab", "--poses", poses, "--have", poses, "-n", "3", "--repeats", "0", "-o", more)
    assert numbers_of(read_csv(more, ["pose"]), "pose").tolist() == [36, 37, 38]


@pytest.mark.parametrize("name", ["so100", "so101", "koch", "lekiwi"])
def test_poses_of_an_arm_on_a_table_stay_above_it(name: str) -> None:
    arm, levels = load_arm(name), parse_levels(load_arm(name), "5")
    assert lowest_point(arm, candidate_grid(arm, levels).q) < 0.0
    above = candidate_grid(arm, levels, ClearanceRules(floor=floor_above_table(arm)))
    assert lowest_point(arm, above.q) >= 0.03
    assert any("below z = 30 mm" in rule for rule in above.rejected)


@pytest.mark.long
def test_the_command_keeps_above_the_table_unless_told_otherwise(tmp_path: Path) -> None:
    words = ["design", "so101", "-n", "20", "--repeats", "0", "--parameters", "compliance.*", "-o", tmp_path / "n.csv"]
    for floor, above in (("", True), ("none", False)):
        code, said, complaint = run_command(*words, "--floor-mm", floor)
        assert (code, complaint) == (0, "")
        assert ("Joints and TCP stay above z = 30 mm" in said) is above
        lowest = lowest_point(load_arm("so101"), load_poses(tmp_path / "n.csv", load_arm("so101")).q)
        assert (lowest >= 0.03) is above


def test_an_arm_that_says_nothing_of_a_table_is_warned_of_poses_below_its_base() -> None:
    words = ["design", "ur5", "--levels", "3", "-n", "30", "--repeats", "0"]
    assert "notice: some poses go down to z = -" in " ".join(run_command(*words)[2].split())
    assert "a height in mm such as 30, or none" in stderr_of(*words, "--floor-mm", "low")


@pytest.mark.long
@pytest.mark.parametrize("count", [6, 40])
def test_fewer_poses_than_a_fit_takes_are_said_to_be_too_few(tmp_path: Path, count: int) -> None:
    said = stdout_of("design", "two-joint", "--levels", "9", "-n", count, "-o", tmp_path / "next.csv")
    title = re.search(r"^(\d+) poses, (\d+) parameters", said, re.MULTILINE)
    assert ("too few for a fit" in said) == (int(title[1]) < int(title[2]))


@pytest.mark.slow
def test_choosing_among_the_shipped_measurements(tmp_path: Path) -> None:
    example = EXAMPLE
    words = ["-o", tmp_path / "few.csv", "--json", tmp_path / "c.json", "--figure", tmp_path / "c.png"]
    stdout_of("choose-poses", example, "--arm", "lrm-lab", "-n", "40", *words)
    told = json.loads((tmp_path / "c.json").read_text())
    assert numbers_of(read_csv(tmp_path / "few.csv", ["x_mm"]), "pose").tolist() == told["poses"]
    assert told["observability"]["O1"] <= told["o1_no_choice_exceeds"]
    assert np.count_nonzero(numbers_of(read_csv(tmp_path / "c.csv", ["chosen"]), "chosen")) == 40


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["design", "lrm-lab", "--levels", "3", "--separate", "backlash@joint9"], "joint6"),
        (["design", "lrm-lab", "--levels", "many"], "not a list of numbers"),
        (["design", "lrm-lab", "--levels", "3", "--loads-g", "heavy"], "loads in g"),
        (["design", "lrm-lab", "--levels", "3", "-n", "5"], "at least"),
        (["design", "lrm-lab", "--levels", "3", "--index", "O6"], "O1, O2, O3, O4, O5"),
        (["design", "lrm-lab", "--levels", "3", "--parameters", "option1", "-n", "20"], "determine only 27 of 28"),
        (
            ["design", "lrm-lab", "--levels", "3", "--figure", "{folder}/a.svg", "-o", "{folder}/a.csv"],
            "different names",
        ),
        (["choose-poses", "nothing.csv", "--arm", "lrm-lab"], "no such file"),
    ],
)
def test_bad_words_get_one_line_and_write_nothing(tmp_path: Path, words: list[str], said: str) -> None:
    assert said in stderr_of(*(word.format(folder=tmp_path) for word in words))
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_pose_file_keeps_the_order_in_which_it_was_measured(separating: PoseDesign) -> None:
    """Random order: no joint's angle runs with it, so that a drift is not taken for an error of a joint."""
    order = np.arange(len(separating.poses))
    for joint in range(6):
        assert abs(np.corrcoef(order, separating.poses.q[:, joint])[0, 1]) < 0.5
    assert directions(separating.poses.q, None).shape == separating.poses.q.shape
