"""Which parameters poses can tell."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.number_table import read_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.observability import identification_jacobian, observability
from lrm_ident.design.parameter_elimination import eliminate
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.parameter_sets import TABLE_4_5, THESIS_OPTIONS
from lrm_ident.report.plain_names import symbol
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from tests.support.commands import stderr_of, stdout_of
from tests.support.random_arms import arms, random_arm
from tests.support.sweep import examples

HEADER = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n"


def some_poses(arm: Arm, seed: int, count: int) -> Poses:
    return poses_of(np.random.default_rng(seed).uniform(-1.7, 1.7, (count, arm.dof)))


@pytest.fixture(scope="module")
def at_rest(lab: Arm) -> Equilibrium:
    return solve_equilibrium(nominal_model(lab), some_poses(lab, 0, 100))


def test_letters_of_the_thesis(lab: Arm) -> None:
    letters = [symbol(key) for key in TABLE_4_5]
    assert letters[:5] == ["δα2", "δα3", "δα4", "δα5", "k0"]
    assert {"k6", "δa3", "δθ1", "δd4", "δx_b", "δy_t", "δdd3"} <= set(letters)
    every = [symbol(key) for key in nominal_model(lab).keys]
    assert len(set(every)) == 45


@examples(5, 10)
@given(arms, st.integers(0, 1000), st.sampled_from(["thesis", "scaled"]))
def test_what_is_kept_is_independent_and_the_rest_is_not(arm: Arm, seed: int, units: str) -> None:
    model = nominal_model(arm)
    equilibrium = solve_equilibrium(model, some_poses(arm, seed, 40))
    found = eliminate(equilibrium, model.keys, units, 1e-4)  # type: ignore[arg-type]
    scaled = identification_jacobian(equilibrium, model.keys).reshape(-1, len(model.keys))
    chosen = scaled[:, [model.position(key) for key in found.kept]]
    assert np.linalg.matrix_rank(chosen, tol=1e-9 * np.linalg.norm(scaled)) == len(found.kept)
    assert found.kept_values[units][-1] >= 1e-4  # type: ignore[index]
    last = max((k for k, one in enumerate(found.removals) if one.before >= 1e-9), default=-1)
    for removal, held in [*zip(found.removals, found.held, strict=True)][last + 1 :]:  # no weaker one went after it
        if removal.before < 1e-9:
            column = scaled[:, model.position(removal.key)]
            share = np.linalg.lstsq(chosen, column, rcond=None)[0]
            assert np.linalg.norm(column - chosen @ share) <= 1e-5 * max(np.linalg.norm(column), 1e-9)
            assert held.survival < 1e-6


@pytest.mark.parametrize("seed", [2894])
def test_what_depends_on_a_parameter_that_is_removed_later_is_kept(seed: int) -> None:
    """An inclination went as exactly dependent on a length, then the length as too weak: nothing told the rest."""
    model = nominal_model(random_arm(seed, 5))
    found = eliminate(solve_equilibrium(model, some_poses(model.arm, 0, 40)), model.keys, "thesis", 1e-4)
    assert "offsets.joint3.beta_rad" in found.kept
    assert found.kept_values["thesis"][-1] >= 1e-4
    assert max(one.survival for one in found.held) < 1e-3


@pytest.mark.slow
@given(st.permutations(range(45)))
@examples(5, 10)
def test_the_order_in_which_parameters_are_named_does_not_matter(order: list[int]) -> None:
    arm = load_arm("lrm-lab")
    equilibrium = solve_equilibrium(nominal_model(arm), some_poses(arm, 0, 60))
    keys = equilibrium.model.keys
    assert set(eliminate(equilibrium, [keys[i] for i in order]).kept) == set(eliminate(equilibrium, keys).kept)


def test_what_looks_alike_moves_the_tip_alike(at_rest: Equilibrium) -> None:
    """1 mm of a parameter taken out and the combination named for it put the TCP in the same place."""
    model, found = at_rest.model, eliminate(at_rest, at_rest.model.keys)
    told = {held.key: held for held in found.held}
    assert dict(told["offsets.joint1.d_mm"].combination) == pytest.approx(
        {"offsets.base.x_mm": np.sin(np.pi / 3), "offsets.base.z_mm": np.cos(np.pi / 3)}
    )
    for held in found.held:
        if not held.combination:
            continue
        assert held.survival < 1e-6
        size = 1e-5 / np.linalg.norm([amount for _, amount in held.combination])

        def moved(changes: dict[str, float], size: float = size) -> np.ndarray:
            values = model.values.copy()
            for key, amount in changes.items():
                j = model.position(key)
                values[j] += size * amount * model.parameters[j].si
            return solve_equilibrium(model.with_values(values), at_rest.poses).tcp - at_rest.tcp

        one, other = moved({held.key: 1.0}), moved(dict(held.combination))
        assert np.abs(one - other).max() < 1e-3 * np.abs(one).max() + 2e-9, held.key


def test_the_threshold_counts_poses_and_has_units(at_rest: Equilibrium) -> None:
    keys = at_rest.model.keys
    least = {units: eliminate(at_rest, keys, units, 1e-4).kept_values[units][-1] for units in ("thesis", "scaled")}  # type: ignore[arg-type, index]
    thrice = at_rest.poses.take(np.tile(np.arange(100), 3))
    more = eliminate(solve_equilibrium(at_rest.model, thrice), keys, "thesis", 1e-4)
    assert more.kept_values["thesis"][-1] == pytest.approx(3**0.5 * least["thesis"])
    fewer = eliminate(at_rest, keys, "scaled", 3 * least["scaled"])
    assert len(fewer.kept) < len(eliminate(at_rest, keys, "scaled", 1e-4).kept)
    assert fewer.kept_values["scaled"][-1] >= 3 * least["scaled"]
    with pytest.raises(LrmError, match="lower --threshold"):
        eliminate(at_rest, keys, "thesis", 1e12)


def test_the_28_of_the_thesis_are_independent_on_its_poses(real: Measurements, lab: Arm) -> None:
    equilibrium = solve_equilibrium(nominal_model(lab), real.poses)
    found = eliminate(equilibrium, TABLE_4_5)
    assert set(found.kept) == set(TABLE_4_5)
    assert not found.removals
    every = eliminate(equilibrium, equilibrium.model.keys)
    assert (
        len(every.kept)
        == 34
        == np.linalg.matrix_rank(identification_jacobian(equilibrium, equilibrium.model.keys).reshape(-1, 45))
    )
    whole = observability(identification_jacobian(equilibrium, found.kept))
    assert vars(found.observability["scaled"]) == pytest.approx(vars(whole), rel=1e-9)


def test_the_norm_of_the_thesis(lab: Arm) -> None:
    """Conenna 2024, section 4.6: about 7e5 at the home position, the kinematic one three orders smaller."""
    equilibrium = solve_equilibrium(nominal_model(lab), poses_of(np.zeros(lab.dof)))
    whole, kinematic = (
        np.linalg.norm(identification_jacobian(equilibrium, THESIS_OPTIONS[name], "thesis"))
        for name in ("option1", "option2")
    )
    assert whole == pytest.approx(7e5, rel=0.05)
    assert 2.5 < np.log10(whole / kinematic) < 3.5


def written(folder: Path, arm: Arm) -> Path:
    rows = np.degrees(some_poses(arm, 1, 60).q)
    path = folder / "poses.csv"
    path.write_text(HEADER + "\n".join(",".join(f"{angle:.3f}" for angle in row) for row in rows) + "\n")
    return path


@pytest.mark.slow
def test_the_commands_and_what_stands_behind_their_figures(tmp_path: Path, lab: Arm) -> None:
    poses = written(tmp_path, lab)
    words = ["--json", tmp_path / "i.json", "--figure", tmp_path / "i.svg"]
    said = stdout_of("identify-parameters", "lrm-lab", poses, "--all", *words)
    assert "δd1 moves the tip exactly like +0.866 mm δx_b +0.5 mm δz_b" in said
    found = json.loads((tmp_path / "i.json").read_text())
    assert found["schema"] == "lrm/identifiability/1"
    assert len(found["kept"]) + len(found["removed"]) == 45
    behind = read_csv(tmp_path / "i.csv", ["units", "set", "number", "singular_value_mm"])
    assert len(behind.rows) == 2 * (45 + len(found["kept"]))
    assert (tmp_path / "i.svg").read_text().lstrip().startswith("<?xml")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["identify-parameters", "lrm-leb", "{poses}"], "no such arm"),
        (["identify-parameters", "lrm-lab", "nothing.csv"], "no such file"),
        (["identify-parameters", "lrm-lab", "{poses}", "--units", "inches"], "thesis, scaled"),
        (["identify-parameters", "lrm-lab", "{poses}", "--parameters", "offsets.joint9.*"], "unknown parameter"),
    ],
)
def test_bad_words_get_one_line(tmp_path: Path, lab: Arm, words: list[str], said: str) -> None:
    poses = written(tmp_path, lab)
    assert said in stderr_of(*(word.format(poses=poses) for word in words))
