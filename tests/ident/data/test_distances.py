"""Distances from a fixed point (string, ball bar): read, weighted, fitted alone and beside positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.distances import Distances, PointDistance
from lrm_ident.data.registration.anchor import trilaterate
from lrm_ident.data.registration.checked import load_checked
from lrm_ident.data.registration.distance_check import misread_distances
from lrm_ident.data.registration.set_up import with_set_up
from lrm_ident.data.registration.similarity import robust_similarity
from lrm_ident.data.source import Source
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.screening.candidates import split_testable, unfitted_effects
from lrm_ident.fitting.cross_validation import FOLDS, blocks_of_fit, cross_validated_residual
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.loss import LOSSES, SQUARED, Loss
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_ident.fitting.priors import load_prior
from lrm_ident.report.priors import PriorComparison
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import deployed_part
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.reading import Reading
from tests.support.table_cells import with_cell

pytestmark = pytest.mark.usefixtures("one_step_folds")

SD, POINT = 2e-4, np.array([0.15, -0.45, 0.05])
FROM_POINT = PointDistance((POINT[0], POINT[1], POINT[2]))
ANCHOR = tuple(f"anchor.distance.{axis}_mm" for axis in "xyz")


@pytest.fixture(scope="module")
def lab() -> Arm:
    return load_arm("lrm-lab")


def true_model(arm: Arm, **more: float) -> Model:
    """Errors of assembly and springs, and parameters `effect__place__name` of further effects."""
    names = ["offsets", "compliance", *dict.fromkeys(name.rsplit("__", 1)[0].replace("__", "@") for name in more)]
    model = nominal_model(arm, names)
    rng = np.random.default_rng(3)
    values = {
        key: float(abs(rng.normal(0, 0.2)) if key.startswith("compliance") else rng.normal(0, 0.2)) * p.typical
        for key, p in zip(model.keys, model.parameters, strict=True)
        if key.split(".")[0] in ("offsets", "compliance")
    }
    return model_of(arm, model.effects, values | {key.replace("__", "."): value for key, value in more.items()})


def measured(model: Model, poses: int, seed: int, positions: int = 0, point: bool = True) -> Measurements:
    """Distances from `POINT`, with positions of the first so many poses; `point`: whether it is stated."""
    rng = np.random.default_rng(seed)
    limits = np.array([(joint.lower, joint.upper) for joint in model.arm.joints]) * 0.6
    equilibrium = solve_equilibrium(model, poses_of(rng.uniform(*limits.T, (poses, model.arm.dof))))
    number, sd = np.arange(1, poses + 1), np.full(poses, SD)
    tcp = np.where(number[:, None] <= positions, equilibrium.tcp + rng.normal(0, SD, (poses, 3)), np.nan)
    distance = np.linalg.norm(FROM_POINT.line(equilibrium), axis=1) + rng.normal(0, SD, poses)
    seen = Distances(distance, sd, start=FROM_POINT.point if point else None)
    return Measurements.of_tcp(equilibrium.poses, tcp, sd=sd, source=Source(arm=model.arm)).beside(seen)


@pytest.mark.slow
@pytest.mark.parametrize("stated", [True, False])
def test_distances_alone_identify_the_arm(lab: Arm, stated: bool) -> None:
    """The fitted arm predicts distances that were never measured, from that point, within the noise."""
    truth = true_model(lab)
    data = measured(truth, 120, 1, point=stated)
    found = fit_model(nominal_model(lab), data, "identifiable", SQUARED)
    assert (set(ANCHOR) <= set(found.fit.model.free)) is not stated
    assert found.fit.sigma == pytest.approx(SD, rel=0.2)
    fresh = measured(truth, 100, 2, point=stated)
    unseen = np.linalg.norm(fresh.position_error(solve_equilibrium(found.fit.model, fresh.poses)), axis=1)
    assert np.sqrt((unseen**2).mean()) < 2.0 * SD
    told = dict(zip(found.fit.model.free, found.fit.told.tolist(), strict=True))
    turns = [part for key, part in told.items() if key.startswith(("offsets.base.", "offsets.joint1."))]
    assert min(turns) < 0.1, "distances do not tell a turn about their own point"
    left = cross_validated_residual(found.fit.model, data)
    assert np.sqrt((left**2).sum(axis=1).mean()) < 2.0 * SD
    point = POINT if stated else np.array([found.fit.model.value(key) for key in ANCHOR])
    seen, true = (solve_equilibrium(model, fresh.poses).tcp for model in (found.fit.model, truth))
    motion = robust_similarity(seen, true, mirrored=False, scale=1.0)  # a turn about the point does not show
    assert np.sqrt(((motion.apply(seen) - true) ** 2).sum(axis=1).mean()) < 10.0 * SD
    assert np.linalg.norm(motion.apply(point[None])[0] - POINT) < 20.0 * SD


@pytest.mark.slow
def test_a_prior_of_the_arm_says_nothing_of_the_fixed_end(lab: Arm) -> None:
    """It is fitted beside what the prior knows, and found, though far from the arm's base."""
    data, model = measured(true_model(lab), 60, 4, positions=30, point=False), nominal_model(lab)
    prior = load_prior("printed", model)
    found = fit_model(model, data, "identifiable", SQUARED, prior=prior).fit
    assert not set(ANCHOR) & set(prior.keys)
    assert np.linalg.norm([found.model.value(key) for key in ANCHOR] - POINT) < 20.0 * SD
    beside = PriorComparison(prior, found, HeldOutResidual(None), "not tried", HeldOutResidual(None))
    assert {row["parameter"]: row["prior"] for row in beside.blocks()[0].records()}["anchor.distance.x"] == "none"


@pytest.mark.slow
def test_the_intervals_hold_the_truth_as_often_as_they_say(lab: Arm) -> None:
    names = ("offsets@joint2", "compliance", "anchor")
    truth = model_of(lab, [effect for name in names for effect in effects_at(lab, name)])
    keys = ("offsets.joint2.theta_rad", "compliance.joint2.k_rad_per_Nm", "compliance.joint3.k_rad_per_Nm", *ANCHOR)
    exact = dict(zip(keys, (0.02, 0.04, 0.05, *POINT.tolist()), strict=True))
    truth = model_of(lab, truth.effects, {**exact, **dict.fromkeys(ANCHOR, 0.0)})
    z = []
    for seed in range(25):
        data = measured(truth, 40, seed, positions=5, point=False)
        found = fit(replace(with_set_up(truth, data), free=keys), data)
        estimate = np.array([found.model.value(key) for key in keys])
        z.append((estimate - list(exact.values())) / found.standard_error)
    within = np.mean(np.abs(z) < 1.96)
    assert 0.90 <= within <= 0.99


@pytest.mark.slow
def test_distances_help_positions_and_a_stated_point_may_be_wrong(lab: Arm) -> None:
    truth = true_model(lab)
    few = measured(truth, 90, 4, positions=45)
    alone = few.take(few.positions.rows)
    without = replace(alone, observations=(alone.positions,))
    elsewhere = measured(truth, 100, 9).poses
    there = solve_equilibrium(truth, elsewhere).tcp

    def tip(data: Measurements) -> float:
        model = fit_identifiable(nominal_model(lab), data, nominal_model(lab).keys).fit.model
        return float(np.sqrt(((solve_equilibrium(model, elsewhere).tcp - there) ** 2).sum(axis=1).mean()))

    assert tip(few) < tip(without)
    positions, seen = few.observations
    off = replace(few, observations=(positions, replace(seen, start=(POINT[0], POINT[1] + 0.004, POINT[2]))))
    seen = diagnose(fit_model(nominal_model(lab), off, "identifiable", SQUARED).fit.model, off)
    assert [one.name for one in seen.supported][:1] == ["anchor@distance"]
    _, missing = split_testable(unfitted_effects(seen.fit.model), seen.fit.equilibrium, without.sensed)
    assert "anchor" in {effect.id for effect, _ in missing}


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_few_distances_of_an_arm_that_may_turn_about_their_fixed_end_converge(seed: int) -> None:
    """Before: a fit crept along the turns of the whole arm, and ended after 300 steps without converging."""
    arm = load_arm("two-joint")
    data = measured(true_model(arm), 16, seed, point=False)
    found = fit_model(nominal_model(arm), data, "identifiable", SQUARED).fit
    assert found.steps < 100
    assert len(blocks_of_fit(found, data)) == FOLDS


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.name)
def test_no_clean_distance_is_an_outlier_and_robust_losses_keep_the_noise(lab: Arm, loss: Loss) -> None:
    truth = true_model(lab)
    free = truth.with_free(["compliance.joint2.k_rad_per_Nm", "compliance.joint3.k_rad_per_Nm"])
    found = fit(free, measured(truth, 300, 5), loss=loss)
    assert not found.outliers
    assert found.weight.mean() > 0.9
    assert found.sigma == pytest.approx(SD, rel=0.15)


def test_trilateration() -> None:
    tcp = np.random.default_rng(0).normal(size=(30, 3))
    point, left = trilaterate(tcp, np.linalg.norm(tcp - POINT, axis=1))
    np.testing.assert_allclose(point, POINT, atol=1e-9)
    assert left < 1e-9


def test_a_rover_needs_no_anchor(lab: Arm) -> None:
    model = model_of(lab, [*effects_at(lab, "compliance"), *effects_at(lab, "anchor")], {ANCHOR[0]: 0.3})
    assert {effect.id for effect in deployed_part(model).effects} == {"compliance"}


def test_written_and_read_again(lab: Arm, tmp_path: Path) -> None:
    data = measured(true_model(lab), 20, 1, positions=8)
    path = tmp_path / "string.csv"
    path.write_text(measurements_csv(data))
    x, y, z = (POINT * 1e3).tolist()
    path.with_suffix(".toml").write_text(f'schema = "lrm/measurements/1"\ndistance_from_mm = [{x}, {y}, {z}]\n')
    again = load_measurements(path, lab)
    equilibrium = solve_equilibrium(true_model(lab), again.poses)
    np.testing.assert_allclose(again.residual(equilibrium), data.residual(equilibrium), atol=1e-8)
    np.testing.assert_allclose(again.whitening.root, data.whitening.root, rtol=1e-5)
    assert again.measured_rows == 8 * 3 + 20
    only = tmp_path / "only.csv"
    only.write_text(measurements_csv(measured(true_model(lab), 20, 1)))
    assert "x_mm" not in only.read_text()
    assert load_measurements(only, lab).measured_rows == 20


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("distance_mm", "-3", "not above zero"),
        ("distance_mm", "far", "not a number"),
        ("distance_mm", "nan", "not a finite number"),
        ("distance_sd_mm", "0", "not above zero"),
        ("distance_sd_mm", None, "some rows have positions, others only distances"),
        ("y_mm", None, "missing column y_mm"),
        ("x_mm", "", "the rest of the position is not"),
    ],
)
def test_bad_distances_in_one_line(lab: Arm, tmp_path: Path, column: str, value: str | None, words: str) -> None:
    text = with_cell(measurements_csv(measured(true_model(lab), 12, 1, positions=6)), column, value)
    (path := tmp_path / "bad.csv").write_text(text)
    with pytest.raises(FileError, match=words):
        load_measurements(path, lab)


def test_a_row_without_anything_and_a_point_that_is_none(lab: Arm, tmp_path: Path) -> None:
    text = with_cell(measurements_csv(measured(true_model(lab), 12, 1)), "distance_mm", "", line=4)
    (path := tmp_path / "bad.csv").write_text(text)
    with pytest.raises(FileError, match="no position either"):
        load_measurements(path, lab)
    path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\ndistance_from_mm = [1.0, nan, 2.0]\n')
    with pytest.raises(FileError, match="distance_from_mm"):
        load_measurements(path, lab)


def test_another_unit_is_noticed(lab: Arm) -> None:
    data = measured(true_model(lab), 40, 1, point=False)
    positions, seen = data.observations
    metres_as_mm = replace(seen, values=1e-3 * seen.values)
    with pytest.raises(FileError, match="unit of distance_mm"):
        with_set_up(nominal_model(lab), replace(data, observations=(positions, metres_as_mm)))
    with pytest.raises(FileError, match="3 distances"):
        with_set_up(nominal_model(lab), data.take(np.arange(3)))


@pytest.mark.parametrize("point", [True, False], ids=["a known point", "an unknown point"])
@pytest.mark.parametrize(
    ("change", "options"),
    [
        ({"q": np.radians}, {"angle_unit": "rad"}),
        ({"q": lambda q: q * [1, 1, -1, 1, 1, 1]}, {"joint_sign": [1, 1, -1, 1, 1, 1]}),
        ({"q": lambda q: q[:, [0, 2, 1, 3, 4, 5]]}, {"joint_order": [1, 3, 2, 4, 5, 6]}),
        ({"distance": lambda d: 1e-3 * d}, {"unit": "m"}),
    ],
)
def test_misread_distances_are_named_and_the_remedy_reads_them(
    lab: Arm, tmp_path: Path, point: bool, change: dict[str, Callable[[Array], Array]], options: dict[str, object]
) -> None:
    data, path = measured(true_model(lab), 60, 1), tmp_path / "string.csv"
    q, distance = np.degrees(data.poses.q), data.observations[1].values
    q, distance = change.get("q", np.array)(q), change.get("distance", np.array)(1e3 * distance)
    header = ",".join([*(f"q{j}" for j in range(1, 7)), "distance"])
    np.savetxt(path, np.column_stack([q, distance]), delimiter=",", header=header, comments="")
    beside = f"distance_from_mm = {(1e3 * POINT).tolist()}" if point else ""
    path.with_suffix(".toml").write_text(f'schema = "lrm/measurements/1"\ndistance_sd_mm = 0.2\n{beside}\n')
    name = next(iter(options)).replace("_", "-")
    with pytest.raises(FileError, match=f"look.*if so: --{name}"):
        load_checked(path, lab)
    assert len(load_checked(path, lab, Reading.model_validate(options))) == 60


def test_distances_of_a_real_arm_are_taken_as_read(lab: Arm) -> None:
    for seed in range(3):
        for point in (True, False):
            data = measured(true_model(lab), 40, seed, point=point)
            assert misread_distances(lab, data, *data.of(Distances)) is None
