"""The deployed model and its steps: what a session leaves behind goes along, names are structure."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.study.model_history import as_written
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import ModelPart, effects_at
from lrm_math.effects.compliance import Compliance
from lrm_math.effects.offsets import Offsets
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import as_deployed, of_a_session
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import DeployedTable, HistoryTable, ModelFile, as_tables, to_model
from lrm_math.model.state_after_session import state_after_session
from lrm_math.model.step_name import ADD, FIT, REFIT, TRANSFER, StepName
from tests.support.sweep import examples

LAB = load_arm("lrm-lab")
COUNT = 24


def session_poses(arm: Arm, seed: int) -> Poses:
    """Poses in random order over an hour, the second half in another power cycle."""
    plain = poses_of(np.random.default_rng(seed).uniform(-0.8, 0.8, (COUNT, arm.dof)))
    number, time = np.arange(1, COUNT + 1), 150.0 * np.arange(COUNT)
    return replace(plain, number=number, t=time, running=time, session=1.0 + (number > COUNT // 2))


def model_with(values: dict[str, float]) -> Model:
    """The lab arm with offsets, compliance and these parameters (SI)."""
    names = dict.fromkeys(key.split(".")[0] + "@" + key.split(".")[1] for key in values)
    extra = [one for name in names if not name.startswith("offsets") for one in effects_at(LAB, name)]
    effects = [*effects_at(LAB, "offsets"), *effects_at(LAB, "compliance"), *extra]
    return model_of(LAB, effects, {"compliance.joint2.k_rad_per_Nm": 0.02} | values)


def fitted(model: Model, poses: Poses) -> Model:
    """The model with the state that its session effects leave behind at these poses."""
    return model.with_state(state_after_session(solve_equilibrium(model, poses)))


@pytest.mark.long
@given(st.sampled_from(["joint1", "joint3", "base"]), st.integers(0, 2**31), st.floats(-0.1, 0.1))
@examples(10, 20)
def test_the_last_state_of_drift_and_session_goes_along(place: str, seed: int, size: float) -> None:
    """Deployed, the arm is where the whole model has it at the last pose's time and session."""
    end = "_alpha_rad" if place == "base" else "_rad"
    model = model_with({f"drift.{place}.A{end}": size, f"session.{place}.step2{end}": -0.4 * size})
    poses = session_poses(LAB, seed)
    deployed = as_deployed(fitted(model, poses))
    assert not any(of_a_session(effect) for effect in deployed.effects)
    last = poses.take([COUNT - 1] * COUNT)
    now = replace(last, q=poses.q, payload=poses.payload)
    np.testing.assert_allclose(solve_equilibrium(deployed, poses).tcp, solve_equilibrium(model, now).tcp, atol=1e-9)


def test_a_mean_state_is_the_mean_over_the_measured_poses() -> None:
    """A moment that is stated goes before the usual one, and stays when the model is fitted again."""
    model, poses = model_with({"session.joint2.step2_rad": 0.02}), session_poses(LAB, 1)
    settled = solve_equilibrium(model, poses)
    state = state_after_session(settled, {"session@joint2": "mean"})
    assert state.offsets == pytest.approx({"offsets.joint2.theta_rad": 0.01})
    again = state_after_session(replace(settled, model=model.with_state(state)))
    assert again == state


@given(st.integers(0, 2**31), st.floats(1e-6, 5e-3) | st.floats(-5e-3, -1e-6))
@examples(5, 10)
def test_the_rigid_motion_of_a_distorted_tracker_goes_to_the_base(seed: int, stretch: float) -> None:
    """The rest of the distortion that is not deployed has no mean: a stretch about the points' own centre."""
    model, poses = model_with({"measurement_frame.frame.scale_x_mm_per_m": stretch}), session_poses(LAB, seed)
    seen = solve_equilibrium(model, poses)
    left = seen.tcp - solve_equilibrium(as_deployed(fitted(model, poses)), poses).tcp
    before = seen.tcp - seen.true_tcp
    assert (left**2).sum() <= (before**2).sum()
    assert np.abs(left.mean(axis=0)).max() <= 0.01 * np.abs(before).max()


@given(st.integers(0, 2**31), st.floats(1e-4, 5e-3) | st.floats(-5e-3, -1e-4))
@examples(5, 10)
def test_of_lengths_that_grow_the_base_takes_the_end(seed: int, growth: float) -> None:
    """A rover is driven in the frame that the tracker shows last, not in that of the middle of its session."""
    model, poses = model_with({"drift.frame.A_mm_per_m": growth}), session_poses(LAB, seed)
    deployed = solve_equilibrium(as_deployed(fitted(model, poses)), poses).tcp
    now = replace(poses.take([COUNT - 1] * COUNT), q=poses.q, payload=poses.payload)
    last = solve_equilibrium(model, now)
    moved = np.abs((last.tcp - last.true_tcp).mean(axis=0)).max()
    assert np.abs((last.tcp - deployed).mean(axis=0)).max() <= 0.02 * moved


def test_a_curve_of_all_lengths_is_zero_at_the_start() -> None:
    """Equal coefficients, a scale of the whole session, move nothing: they would be longer links."""
    keys = effects_at(LAB, "drift_curve@frame")[0].keys
    settled = solve_equilibrium(model_with(dict.fromkeys(keys, 1e-3)), session_poses(LAB, 1))
    np.testing.assert_allclose(settled.tcp, settled.true_tcp, atol=1e-12)
    settled = solve_equilibrium(model_with({keys[3]: 1e-3}), session_poses(LAB, 1))
    assert np.abs(settled.tcp - settled.true_tcp).max() > 1e-5
    np.testing.assert_allclose(settled.tcp[0], settled.true_tcp[0], atol=1e-12)


def test_a_model_without_session_effects_is_deployed_as_it_is() -> None:
    """Nothing is left out, nothing is added."""
    model = model_with({})
    assert state_after_session(solve_equilibrium(model, session_poses(LAB, 1))) is None
    assert as_deployed(model) is model


def test_the_state_is_in_the_model_file() -> None:
    """Read from its file, a model is deployed as before it was written."""
    model = fitted(model_with({"drift.joint3.A_rad": 0.05}), session_poses(LAB, 2))
    free = replace(model, free=("drift.joint3.A_rad",))
    read = as_written(free, "lrm-lab")
    assert read.state.carried == {"drift@joint3": "last"}
    poses = session_poses(LAB, 3)
    np.testing.assert_allclose(
        solve_equilibrium(as_deployed(read), poses).tcp, solve_equilibrium(as_deployed(model), poses).tcp, atol=1e-12
    )


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (DeployedTable(carried={"drift@joint9": "last"}), "drift@joint9"),
        (DeployedTable(offsets={"offsets.joint9.theta_rad": 0.1}), "offsets.joint9.theta_rad"),
    ],
)
def test_a_state_of_what_is_not_there_is_refused(table: DeployedTable, said: str) -> None:
    """One line that names the key."""
    file = ModelFile(schema="lrm/model/1", arm="lrm-lab", effects=["offsets"], deployed=table)
    with pytest.raises(FileError, match=said):
        to_model(Path("model.toml"), file, LAB)


def test_every_effect_belongs_to_a_part() -> None:
    """Base and tool are the installation's, the tracker's frame is the measurement's, the rest is the arm's."""
    parts = {
        name: effects_at(LAB, name)[0].part
        for name in ("offsets@joint1", "offsets@base", "payload@tool", "measurement_frame@frame", "drift@joint2")
    }
    assert parts == {
        "offsets@joint1": ModelPart.ARM,
        "offsets@base": ModelPart.INSTALLATION,
        "payload@tool": ModelPart.INSTALLATION,
        "measurement_frame@frame": ModelPart.MEASUREMENT,
        "drift@joint2": ModelPart.ARM,
    }


EVERY = [StepName(FIT), StepName(ADD, "cable_curve@joint1+joint2"), StepName(REFIT, "a b"), StepName(TRANSFER, "lab")]
AFTER = {"fit_rms_mm": 1.0, "effects": [], "parameters": {}}


@pytest.mark.parametrize("name", EVERY, ids=lambda name: name.kind)
def test_a_step_of_version_1_is_read_from_its_name(name: StepName) -> None:
    assert StepName.of_version_1(str(name)) == name
    entry = HistoryTable.model_validate({"step": str(name), **AFTER})
    assert (entry.name, entry.name.added) == (name, name.of if name.kind == ADD else "")
    assert HistoryTable.model_validate(entry.model_dump(exclude_none=True)) == entry, "and as it is written now"


def test_rivals_in_a_sentence_of_version_1_are_names() -> None:
    said = "add hysteresis@joint3, or drift@joint30 and 1 more, slip@joint2: these data cannot tell"
    entry = HistoryTable.model_validate({"step": said, **AFTER})
    assert entry.name == StepName(ADD, "hysteresis@joint3")
    assert entry.indistinguishable == ["drift@joint30", "slip@joint2"]


def test_what_names_no_cause_was_said_behind_a_comma() -> None:
    assert StepName.of_version_1("add residual_field@tool, names no cause: smooth").added == "residual_field@tool"


def test_an_unknown_step_is_its_own_name() -> None:
    assert str(StepName.of_version_1("by hand, twice")) == "by hand, twice"


def test_version_1_becomes_version_2() -> None:
    file = ModelFile.model_validate({"schema": "lrm/model/1", "arm": "lrm-lab", "effects": []})
    assert as_tables(file)["schema"] == "lrm/model/2"


def test_a_used_model_is_pickled() -> None:
    arm = load_arm("lrm-lab")
    effects = [kind(arm, place) for kind in (Offsets, Compliance) for place in kind.places(arm)]
    model = model_of(arm, effects, {"compliance.joint2.k_rad_per_Nm": 0.05})
    poses = poses_of(np.zeros((3, arm.dof)), 0.0663)
    expected = solve_equilibrium(model, poses).tcp
    assert isinstance(hash(arm), int)
    assert b"_hash" not in pickle.dumps(arm)  # hashes of texts differ between processes
    sent = pickle.loads(pickle.dumps(model))
    assert sent.arm == arm
    assert np.array_equal(solve_equilibrium(sent, poses).tcp, expected)
