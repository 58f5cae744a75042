"""Maximum a posteriori (thesis Eq 2.66): what a prior may do, what it must not, and the prior of typical sizes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.fitting import cross_validation
from lrm_ident.fitting.cross_validation import held_out_blocks
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.loss import SQUARED, loss_named
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_ident.fitting.parameter_sets import no_bounds, select_parameters
from lrm_ident.fitting.priors import Prior, PriorFile, load_prior, shipped_priors, to_prior
from lrm_ident.fitting.typical_prior import TYPICAL, typical_prior
from lrm_math.arm.arm import Arm, TypicalSizes
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError, UnknownName
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.covariance import CovarianceTable
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import measured_range, solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_covariance
from tests.conftest import EXAMPLE
from tests.support.commands import part_of_example, stderr_of, stdout_of
from tests.support.sweep import examples
from validation import synthetic, synthetic_measurements
from validation.interval_coverage import all_with_prior, option_1


def prior_of_typical_sizes(model: Model, sizes: float = 1.0) -> Prior:
    """Zero-mean prior whose standard deviations are `sizes` typical sizes."""
    file = PriorFile(schema="lrm/prior/1", name=f"{sizes:g} typical sizes", other_sd=sizes)
    return to_prior(Path(file.name), file, model)


def correlated(prior: Prior, seed: int) -> Prior:
    """The same standard deviations with random correlations."""
    factors = np.random.default_rng(seed).normal(size=(len(prior.keys), 5))
    covariance = factors @ factors.T + np.eye(len(prior.keys))
    size = np.sqrt(np.diag(prior.covariance) / np.diag(covariance))
    return replace(prior, covariance=covariance * np.outer(size, size))


@pytest.fixture(scope="module")
def whole(lab: Arm) -> Model:
    """All 45 parameters of levels 2 and 3, free."""
    model = nominal_model(lab)
    return replace(model, free=model.keys)


def measured(seed: int, count: int, noise: float = 3e-4) -> Measurements:
    """Random poses of a random arm of the independent generator."""
    rig = synthetic.load_arm(shipped_arms()["lrm-lab"])
    q = synthetic.random_poses(rig, count, seed)
    return synthetic_measurements.measured(rig, synthetic.GroundTruth.random(rig, seed), q, seed, noise=noise)


def normal_matrix(found: Fit, prior: Prior) -> tuple[np.ndarray, np.ndarray]:
    """JᵀJ/σ² + Λ⁻¹ and JᵀJ/σ² at the estimate, SI."""
    J = parameter_jacobian(found.equilibrium, found.model.free).reshape(-1, len(found.model.free))
    data = J.T @ J / found.sigma**2
    return data + np.linalg.inv(prior.covariance_of(found.model.free)), data


@pytest.mark.slow
@given(seed=st.integers(0, 1000), sizes=st.floats(0.1, 3.0), count=st.integers(20, 60))
@examples(3, 6)
def test_the_estimate_is_the_top_of_the_posterior(whole: Model, seed: int, sizes: float, count: int) -> None:
    data, prior = measured(seed, count), correlated(prior_of_typical_sizes(whole, sizes), seed)
    found = fit(whole, data, no_bounds(whole.free), prior=prior)
    J = parameter_jacobian(found.equilibrium, whole.free).reshape(-1, len(whole.free))
    root = np.linalg.cholesky(prior.covariance_of(whole.free))
    to_data = root.T @ J.T @ found.residual.reshape(-1) / found.sigma**2
    to_prior = np.linalg.solve(root, found.model.values - prior.mean_of(whole.free))
    assert np.abs(to_data - to_prior).max() < 0.02 * max(1.0, np.abs(to_prior).max())


@pytest.mark.slow
def test_a_prior_far_too_narrow_still_ends(whole: Model) -> None:
    """The noise that a tenfold too narrow prior leaves follows slowly from itself; the estimate is its fixed point."""
    data = measured(500, 60)
    found = fit(whole, data, no_bounds(whole.free), prior=prior_of_typical_sizes(whole, 0.1))
    again = fit(found.model, data, no_bounds(whole.free), prior=prior_of_typical_sizes(whole, 0.1))
    assert again.sigma == pytest.approx(found.sigma, rel=2e-2)
    assert 3e-4 < found.sigma < 5e-4


def test_the_covariance_is_that_of_the_posterior(whole: Model) -> None:
    data, prior = measured(3, 60), correlated(prior_of_typical_sizes(whole), 3)
    found = fit(whole, data, no_bounds(whole.free), prior=prior)
    precision, told = normal_matrix(found, prior)
    scale = np.sqrt(np.diag(found.covariance))
    ours, theirs = (matrix / np.outer(scale, scale) for matrix in (found.covariance, np.linalg.inv(precision)))
    np.testing.assert_allclose(ours, theirs, atol=5e-3)
    assert np.all(found.standard_error <= prior.sd_of(whole.free) * 1.003)
    assert found.effective_parameters == pytest.approx(np.trace(np.linalg.solve(precision, told)), rel=1e-3)
    assert found.effective_parameters < len(whole.free) - 10  # the 45 hold at least ten combinations that move nothing


def test_a_prior_that_knows_nothing_changes_nothing(whole: Model) -> None:
    data = measured(5, 80)
    model = replace(whole, free=select_parameters(whole, "option1"))
    plain = fit(model, data)
    vague = fit(model, data, prior=prior_of_typical_sizes(model, 1e4))
    moved = np.array([vague.model.value(k) - plain.model.value(k) for k in model.free])
    assert np.abs(moved / np.maximum(plain.standard_error, 1e-12)).max() < 0.01
    np.testing.assert_allclose(vague.standard_error, plain.standard_error, rtol=1e-2)
    assert vague.effective_parameters == pytest.approx(plain.effective_parameters, abs=0.01)


def test_a_prior_that_knows_everything_is_believed(whole: Model) -> None:
    data, sure = measured(5, 40), prior_of_typical_sizes(whole, 1e-7)
    found = fit(whole, data, no_bounds(whole.free), prior=sure)
    typical = np.array([parameter.typical for parameter in whole.parameters])
    assert np.abs(found.model.values / typical).max() < 1e-5
    assert found.effective_parameters < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_robust_losses_take_a_prior_too(whole: Model, loss: str) -> None:
    data = measured(8, 60)
    spoiled = data.tcp.copy()
    spoiled[::15] += 0.1
    prior = prior_of_typical_sizes(whole)
    clean = fit(whole, data, prior=prior)
    found = fit(whole, data.with_tcp(spoiled), loss=loss_named(loss), prior=prior)
    fresh = measured(8, 300, noise=0.0)
    rms = [
        np.sqrt(((fresh.tcp - solve_equilibrium(one.model, fresh.poses).tcp) ** 2).sum(1).mean())
        for one in (clean, found)
    ]
    assert rms[1] < 2.0 * rms[0]


@pytest.mark.slow
def test_it_predicts_no_worse_than_elimination(whole: Model) -> None:
    prior, left = load_prior("printed", whole), []
    for seed in range(4):
        data = measured(seed, 45)
        rig = synthetic.load_arm(shipped_arms()["lrm-lab"])
        q = synthetic.random_poses(rig, 200, seed + 500)
        truth = synthetic.measure(rig, synthetic.GroundTruth.random(rig, seed), q)
        for found in (fit(whole, data, prior=prior), fit_identifiable(replace(whole, free=()), data, whole.keys).fit):
            left.append(((truth - solve_equilibrium(found.model, poses_of(q)).tcp) ** 2).sum(1).mean())
    with_prior, eliminated = np.array(left).reshape(-1, 2).mean(axis=0)
    assert with_prior < 1.05 * eliminated


@pytest.mark.slow
def test_stated_errors_are_honest() -> None:
    for found in (option_1(range(16)), all_with_prior(range(8), poses=60)):
        assert 0.90 < found.within_95 < 0.985
        assert found.within_3 >= 0.985


def test_data_without_noise_are_no_trouble(whole: Model) -> None:
    prior = prior_of_typical_sizes(whole)
    data = measured(2, 60, noise=0.0)
    rng = np.random.default_rng(2)
    true = whole.with_values(rng.normal(0.0, 0.3, len(whole.keys)) * prior.sd_of(whole.keys))
    exact = data.with_tcp(solve_equilibrium(true, data.poses).tcp)
    found = fit(whole, exact, no_bounds(whole.free), prior=prior)
    assert found.sigma < 1e-6
    deviation = (found.model.values - true.values) / prior.sd_of(whole.keys)
    assert np.abs(deviation).max() < 3.0  # combinations that move nothing stay with the prior, and it says so
    assert found.standard_error.max() > 0.5 * prior.sd_of(whole.keys).min()


@pytest.mark.long
def test_fewer_poses_than_parameters_will_do_but_not_too_few(whole: Model) -> None:
    prior = prior_of_typical_sizes(whole)
    assert fit(whole, measured(1, 20), prior=prior).effective_parameters < 45
    with pytest.raises(LrmError, match="measure at least 16 poses"):
        fit(whole, measured(1, 15), prior=prior)
    with pytest.raises(LrmError, match="measure at least 45 poses"):
        fit(whole, measured(1, 20))


@pytest.mark.long
def test_too_few_for_the_held_out_error_are_counted_as_the_user_does(whole: Model) -> None:
    prior = prior_of_typical_sizes(whole)
    with pytest.raises(LrmError, match=r"17 poses for 45 parameters.* other 15 needs 16; measure at least 18 poses"):
        held_out_blocks(whole, measured(1, 17), prior=prior)
    assert len(held_out_blocks(whole, measured(1, 18), prior=prior)) == 10


@pytest.mark.parametrize("arm", sorted(shipped_arms()))
def test_shipped_priors_fit_every_arm(arm: str) -> None:
    the_arm = load_arm(arm)
    model = nominal_model(the_arm)
    assert set(shipped_priors()) >= {"printed", "vague"}
    for name in shipped_priors():
        prior = load_prior(name, model)
        assert prior.keys == model.keys
        assert prior.sd_of(prior.keys).min() > 0


def prior_file(parameters: dict[str, object]) -> PriorFile:
    return PriorFile.model_validate({"schema": "lrm/prior/1", "name": "mine", "parameters": parameters})


def test_the_last_pattern_that_matches_holds(whole: Model) -> None:
    file = prior_file(
        {
            "compliance.*": {"mean": 0.1, "sd": 0.2},
            "compliance.joint3.*": {"mean": 0.05, "sd": 0.01},
            "offsets.*_mm": {"sd": 2.0},
        }
    )
    prior = to_prior(Path("mine"), file, whole)
    keys = ["compliance.joint2.k_rad_per_Nm", "compliance.joint3.k_rad_per_Nm", "offsets.joint3.a_mm"]
    np.testing.assert_allclose(prior.mean_of(keys), [0.1, 0.05, 0.0])
    np.testing.assert_allclose(prior.sd_of(keys), [0.2, 0.01, 0.002])
    untouched = "offsets.joint2.alpha_rad"
    assert prior.sd_of([untouched])[0] == whole.parameter(untouched).typical
    with pytest.raises(UnknownName):
        prior.mean_of(["drift.joint2.A_rad"])


@pytest.mark.long
def test_a_shape_is_fitted_where_the_prior_has_its_whole_key(lab: Arm) -> None:
    """Data that say little of it leave it at the prior's mean; a pattern leaves it where it was."""
    names = ("offsets", "compliance", "backlash@joint2")
    model = model_of(lab, [effect for name in names for effect in effects_at(lab, name)])
    shape, data = "backlash.joint2.tau0_Nm", measured(7, 60)
    named = to_prior(Path("mine"), prior_file({shape: {"mean": 0.05, "sd": 1e-4}}), model)
    pattern = to_prior(Path("mine"), prior_file({"backlash.*": {"sd": 0.01}}), model)
    assert (shape in named.keys, shape in pattern.keys) == (True, False)
    values = [
        fit_model(model, data, "identifiable", SQUARED, prior=one).fit.model.value(shape) for one in (named, pattern)
    ]
    assert values == [pytest.approx(0.05, abs=3e-4), model.value(shape)]


JOINT2, JOINT3 = (f"compliance.joint{number}.k_rad_per_Nm" for number in (2, 3))


def correlated_file(keys: list[str], *correlation: float) -> PriorFile:
    file = prior_file({JOINT2: {"mean": 0.1, "sd": 0.2}, JOINT3: {"mean": 0.1, "sd": 0.1}})
    table = CovarianceTable(keys=keys, correlation=list(correlation))
    return file.model_copy(update={"covariance": table})


def test_correlations_of_a_prior_file(whole: Model) -> None:
    prior = to_prior(Path("mine"), correlated_file([JOINT3, JOINT2], 0.9), whole)
    np.testing.assert_allclose(prior.covariance_of([JOINT2, JOINT3]), [[0.04, 0.018], [0.018, 0.01]])
    other = "offsets.joint2.alpha_rad"
    assert prior.covariance_of([JOINT2, other])[0, 1] == 0.0
    np.testing.assert_allclose(prior.sd_of([JOINT2, JOINT3]), [0.2, 0.1])


@pytest.mark.parametrize(
    ("keys", "correlation", "what"),
    [
        ([JOINT2, "compliance.joint4.k_rad_per_Nm"], [0.5], "is not in"),
        ([JOINT2, JOINT3], [], "0 correlations for 2 keys"),
        ([JOINT2, JOINT2], [0.5], "twice"),
        ([JOINT2, JOINT3], [1.0], "no variance"),
        ([JOINT2, JOINT3], [1.5], "contradict"),
    ],
)
def test_wrong_correlations_are_one_line(whole: Model, keys: list[str], correlation: list[float], what: str) -> None:
    with pytest.raises(FileError, match=what):
        to_prior(Path("mine.toml"), correlated_file(keys, *correlation), whole)


def test_patterns_that_fit_nothing_are_named(whole: Model) -> None:
    with pytest.raises(FileError, match=r"offsets.joint\*.thta_rad"):
        to_prior(Path("mine.toml"), prior_file({"offsets.joint*.thta_rad": {"sd": 0.1}}), whole)
    with pytest.raises(FileError, match="printed"):
        load_prior("nothing-like-it", whole)


@pytest.mark.long
@pytest.mark.parametrize("fault", ["sd = 0.0", "sd = -1.0", "sd = nan", "width = 1.0"])
def test_a_wrong_prior_is_one_line(tmp_path: Path, fault: str) -> None:
    path = tmp_path / "prior.toml"
    path.write_text(f'schema = "lrm/prior/1"\nname = "x"\n[parameters]\n"offsets.base.x_mm" = {{ {fault} }}\n')
    assert "prior.toml" in stderr_of("fit", EXAMPLE, "--prior", path, "-o", tmp_path / "m.toml")
    assert not (tmp_path / "m.toml").exists()


@pytest.mark.slow
def test_the_commands_know_the_prior(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cross_validation, "MOST_REFITTED", 0)
    model, data = tmp_path / "map.toml", part_of_example(tmp_path, 90)
    said = stdout_of("fit", data, "--prior", "printed", "-o", model, "--json", tmp_path / "fit.json")
    assert "With the prior, and with typical sizes" in said
    tables = json.loads((tmp_path / "fit.json").read_text())
    assert tables["parameters"] == len(tables["prior"]["parameters"]) == 45
    assert tables["prior"]["parameters_decided_by_data"] < 45
    covariance = load_covariance(model)
    assert len(covariance.keys) > 40
    assert tables["prior"]["typical_sizes"]["parameters"] == 45
    assert 'prior = "printed"' in model.read_text()
    stdout_of("compare", model, data, "--json", tmp_path / "compare.json")
    error = json.loads((tmp_path / "compare.json").read_text())["error"]
    assert error["held_out"]["rms_mm"] == pytest.approx(tables["error"]["held_out"]["rms_mm"], rel=1e-3)
    stdout_of("add", model, data, "servo_gain@joint2", "-o", tmp_path / "more.toml")
    assert tables["poses"] == 90


@pytest.mark.slow
def test_twenty_poses_are_enough_for_typical_sizes(tmp_path: Path) -> None:
    data = part_of_example(tmp_path, 20)
    stdout_of("fit", data, "-o", tmp_path / "map.toml", "--json", tmp_path / "fit.json")
    tables = json.loads((tmp_path / "fit.json").read_text())
    assert (tables["parameters"], tables["prior"]) == (45, "typical")
    told = [one["told_by_data"] for one in tables["estimates"].values() if one["told_by_data"] is not None]
    assert min(told) < 0.1 < 0.9 < max(told)
    assert 'prior = "typical"' in (tmp_path / "map.toml").read_text()
    assert load_covariance(tmp_path / "map.toml") is not None


def test_a_prior_may_name_parameters_of_forms(lab: Arm) -> None:
    """A fleet's does where some of its arms needed another form of an effect."""
    tables = {"schema": "lrm/prior/1", "name": "x", "parameters": {"torque_curve.joint2.u1_rad": {"sd": 0.1}}}
    model = model_of(lab, effects_at(lab, "compliance"))
    assert to_prior(Path("x.toml"), PriorFile.model_validate(tables), model).keys == model.keys


NOISE = 3e-4  # m


def unstated(seed: int, count: int, noise: float = NOISE) -> Measurements:
    """The same, of a noise that nobody states."""
    data = measured(seed % 1000, count, noise)
    return data.with_positions(replace(data.positions, noise_sd=None))


def seen_by(truth: Model, count: int, seed: int) -> Measurements:
    """Random poses of a model, with noise."""
    rng = np.random.default_rng(seed)
    poses = poses_of(rng.uniform(-1.2, 1.2, (count, truth.arm.dof)))
    truth = replace(truth, within=measured_range(solve_equilibrium(model_of(truth.arm, ()), poses)))
    tcp = solve_equilibrium(truth, poses).tcp + NOISE * rng.normal(size=(count, 3))
    return Measurements.of_tcp(poses, tcp, source=Source(arm=truth.arm))


@pytest.mark.long
@examples(2, 4)
@given(seed=st.integers(0, 500))
def test_the_estimate_is_the_mode_of_gaussians_and_cauchy_distributions(lab: Arm, seed: int) -> None:
    """Central differences of the posterior itself, in standard errors, with the tails that reweighting stands for."""
    model = model_of(lab, [*nominal_model(lab).effects, *effects_at(lab, "servo_gain@joint2")])
    data = unstated(seed, 40)
    found = fit_identifiable(model, data, model.keys).fit
    prior = typical_prior(found.model)
    gaussian = prior.tail == 0.0

    def minus_log_posterior(moved: Model) -> float:
        value = np.array([moved.value(key) for key in prior.keys])
        squares = (value[gaussian] ** 2 / np.diag(prior.covariance)[gaussian]).sum()
        tails = np.log1p((value[~gaussian] / prior.tail[~gaussian]) ** 2).sum()
        left = data.residual(solve_equilibrium(moved, data.poses, tolerance=1e-13))
        return float((left**2).sum() / (2.0 * found.sigma**2) + 0.5 * squares + tails)

    for key, error in zip(found.model.free, found.standard_error, strict=True):
        if key in found.at_bound:
            continue
        step = 1e-2 * error
        ends = (found.model.with_values_of([key], found.model.value(key) + sign * step) for sign in (1, -1))
        up, down = map(minus_log_posterior, ends)
        assert abs(up - down) / (2.0 * step) * error < 0.03, key


def test_wide_sizes_give_least_squares(lab: Arm) -> None:
    wide = replace(lab, typical_sizes=TypicalSizes(5e2, 5e3, 1e4))
    model = model_of(wide, nominal_model(wide).effects)
    keys = tuple(key for key in select_parameters(model, "option1") if ".base." not in key)
    model, data = model.with_free(keys), unstated(5, 80)
    plain, vague = fit(model, data), fit(model, data, prior=typical_prior(model))
    moved = np.array([vague.model.value(key) - plain.model.value(key) for key in keys])
    assert np.abs(moved / np.maximum(plain.standard_error, 1e-12)).max() < 0.01


def test_an_effect_far_beyond_its_typical_size_is_not_lost(lab: Arm) -> None:
    """A tracker that stretches x by 6 %, 180 typical sizes. A Gaussian of that width would lose it.

    A stretch of all axes together is an arm that is longer; what the poses tell is how much more x is stretched.
    """
    x, y, z = (f"measurement_frame.frame.scale_{axis}_mm_per_m" for axis in "xyz")
    truth = model_of(lab, effects_at(lab, "measurement_frame"), {x: 0.06})
    model = model_of(lab, [*nominal_model(lab).effects, *truth.effects])
    data = seen_by(truth, 60, 1)
    found = fit_identifiable(model, data, model.keys).fit
    apart = found.model.value(x) - 0.5 * (found.model.value(y) + found.model.value(z))
    assert apart == pytest.approx(0.06, abs=0.004)
    assert found.sigma < 1.2 * NOISE


@pytest.mark.long
def test_few_poses_are_enough(lab: Arm) -> None:
    """24 poses for 45 parameters: near the noise at fresh poses."""
    fresh = unstated(3003, 300, 0.0)
    model = nominal_model(lab)
    data = replace(unstated(3, 24), source=Source(arm=lab))
    found = fit_model(model, data, "identifiable", SQUARED).fit
    assert len(found.model.free) == 45 > found.effective_parameters
    left = fresh.residual(solve_equilibrium(found.model, fresh.poses))
    assert error_stats(left).rms < 3.0 * np.sqrt(3.0) * NOISE


def test_scales_of_the_parameters_do_not_matter(lab: Arm) -> None:
    """Typical sizes scale the iteration; the estimate follows from the prior alone."""
    data, found = unstated(7, 40), []
    for sizes in (TypicalSizes(), TypicalSizes(3e-4, 0.2, 0.5)):
        model = nominal_model(replace(lab, typical_sizes=sizes))
        model = model.with_free(model.keys)
        sd = np.array([{"rad": 0.05, "mm": 0.005}.get(p.unit, 0.1) for p in model.parameters])
        prior = Prior("one", model.keys, np.zeros(len(sd)), np.diag(sd**2))
        found.append(fit(model, data, prior=prior))
    apart = (found[0].model.values - found[1].model.values) / np.maximum(found[0].standard_error, 1e-12)
    assert np.abs(apart).max() < 0.02


def test_what_no_pose_shows_stays_at_zero_and_the_fit_says_so(lab: Arm) -> None:
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (60, lab.dof)) * (np.arange(lab.dof) != 3)
    model = model_of(lab, [*nominal_model(lab).effects, *effects_at(lab, "servo_gain@joint4")])
    tcp = solve_equilibrium(model, poses_of(q)).tcp + NOISE * rng.normal(size=(60, 3))
    number = np.arange(60)
    data = Measurements.of_tcp(poses_of(q), tcp, pose=number)
    found = fit_identifiable(model, data, [key for key in model.keys if model.parameter(key).fixed is None]).fit
    told = dict(zip(found.model.free, found.told, strict=True))
    gain = [key for key in told if key.startswith("servo_gain")]
    assert max(abs(found.model.value(key)) for key in gain) < 1e-9
    assert max(told[key] for key in gain) < 1e-6
    assert told["offsets.joint2.theta_rad"] > 0.9


def test_an_arm_file_states_its_own_sizes(lab: Arm) -> None:
    machined = replace(lab, typical_sizes=TypicalSizes(5e-5, 1e-3, 1e-3))
    model = nominal_model(machined)
    prior = typical_prior(model.with_free(model.keys))
    assert prior.sd_of(["offsets.joint3.a_mm", "offsets.tool.x_mm"]) == pytest.approx([5e-5, 5e-5])
    assert prior.sd_of(["compliance.joint2.k_rad_per_Nm"]) == pytest.approx([1e-3])
    assert prior.sd_of(["offsets.base.x_mm", "offsets.base.alpha_rad"]) == pytest.approx([0.05, 0.2])
    data = unstated(11, 60)
    assert fit_model(model, data, "identifiable", SQUARED).fit.sigma > 2 * NOISE  # a printed arm is not like that
    assert fit_model(nominal_model(lab), data, "identifiable", SQUARED).fit.stated.name == TYPICAL  # type: ignore[union-attr]


def test_options_of_the_thesis_are_least_squares(lab: Arm) -> None:
    found = fit_model(nominal_model(lab), unstated(2, 60), "option1", SQUARED).fit
    assert found.stated is None
