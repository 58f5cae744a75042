"""The state that a session's effects leave behind: chosen from the data, shown in errors, in every file that leaves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.source import Source
from lrm_ident.diagnosis.confirm import confirm
from lrm_ident.fitting.held_out import deployed_residual
from lrm_ident.report.story import story_of_file
from lrm_ident.residual.deployment.carried_states import rows_as_deployed
from lrm_ident.residual.deployment.rolling_origin import allows_rolling_origin
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import as_deployed, as_deployed_at, followed_parts, of_a_session
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from lrm_math.model.session_state import StateAfterSession
from tests.support.commands import stdout_of

ARM, COUNT, NOISE = "two-joint", 120, 1e-4
DRIFT, SESSION = "drift@joint1", "session@joint1"


def world(values: dict[str, float]) -> Model:
    """The arm as it truly is."""
    arm = load_arm(ARM)
    names = ("offsets@joint1", "compliance@joint2", DRIFT, SESSION)
    return model_of(arm, [effects_at(arm, name)[0] for name in names], values)


def measured(values: dict[str, float], *, numbered: bool = True, load: float = 0.0) -> Measurements:
    """Measurements of a world in random order over five hours, the last two thirds in a second session.

    `load`: kg, at the tool in the second half.
    """
    rng, arm = np.random.default_rng(3), load_arm(ARM)
    plain = poses_of(rng.uniform(-1.2, 1.2, (COUNT, arm.dof)), np.where(np.arange(COUNT) < COUNT // 2, 0.0, load))
    pose, time = np.arange(1, COUNT + 1), 150.0 * np.arange(COUNT)
    session = 1.0 + (pose > COUNT // 3)
    poses = replace(plain, number=pose, t=time, session=session, running=time)
    tcp = solve_equilibrium(world(values), poses).tcp + rng.normal(0.0, NOISE, (COUNT, 3))
    known = poses if numbered else replace(poses, number=None)
    return Measurements.of_tcp(known, tcp, pose=pose, source=Source(Path("data.csv"), "0" * 64, arm=arm, arm_name=ARM))


def fitted(data: Measurements, *names: str) -> Study:
    """The study of these data with effects of a session."""
    effects = ("offsets@joint1", "compliance@joint2", *names)
    keys = [key for name in effects for key in effects_at(load_arm(ARM), name)[0].keys if "extra_z" not in key]
    wanted = [
        key
        for key in keys
        if not key.endswith(("_per_K", "T_s", "stood_s", "rest_s", "late_s_per_s", "reset_s_per_s"))
        and "alpha" not in key
        and "step3" not in key
    ]
    wanted = [key for key in wanted if not key.endswith(("step4_rad", "step5_rad", "step6_rad", ".d_mm", ".a_mm"))]
    return Study.of(data, effects).fit(wanted)


@pytest.mark.parametrize(("name", "size"), [("drift.joint1.A_rad", 0.05), ("session.joint1.step2_rad", 0.04)])
def test_the_deployed_arm_is_the_one_at_the_end(name: str, size: float) -> None:
    """At new poses of the world that goes on, the deployed model is as good as the fit in its session was."""
    effect = DRIFT if name.startswith("drift") else SESSION
    study = fitted(measured({name: size}), effect)
    assert study.model.state.carried == {effect: "last"}
    end = {"offsets.joint1.theta_rad": size * (1.0 - np.exp(-150.0 * COUNT / 1800.0)) if effect == DRIFT else size}
    new = poses_of(np.random.default_rng(9).uniform(-1.2, 1.2, (50, 2)))
    goes_on = solve_equilibrium(world(end), new).tcp
    off = np.linalg.norm(solve_equilibrium(as_deployed(study.model), new).tcp - goes_on, axis=1)
    assert off.max() < 5.0 * NOISE, "the cold arm, or the first session, would be millimetres off"


def test_sixty_poses_suffice_to_see_that_the_arm_stays_warm() -> None:
    """A tenth of them are six; ten are predicted."""
    data = measured({"drift.joint1.A_rad": 0.05}).take(np.arange(0, COUNT, 2))
    state = fitted(data, DRIFT).model.state
    assert state.carried == {DRIFT: "last"}


def test_the_arm_stays_warm_where_it_was_loaded_late() -> None:
    """Loads are measured one after the other, as plans order them; unlike an angle, a load turns no joint's zero."""
    data = measured({"drift.joint1.A_rad": 0.05}, load=0.1)
    state = fitted(data, DRIFT).model.state
    assert state.carried == {DRIFT: "last"}
    assert allows_rolling_origin(data)


def test_both_errors_are_shown_and_apart() -> None:
    """Warm the deployed model is at the noise; over the poses of the cold arm it is not, and that is said."""
    study = fitted(measured({"drift.joint1.A_rad": 0.05}), DRIFT)
    deployed = study.held_out.deployed
    assert deployed.now.rms < 3.0 * study.held_out.error.rms
    assert deployed.otherwise.rms > 5.0 * deployed.now.rms
    entry = study.file.history[-1]
    assert entry.deployed_rms_mm == pytest.approx(1e3 * deployed.now.rms)


def test_an_arm_that_goes_on_changing_states_the_error_of_later_poses() -> None:
    """A zero moves on at one pace, and the model has no law of it: a cross-validation interpolates, and states less."""
    creeping = {"drift.joint1.A_rad": 2.0, "drift.joint1.T_s": 1e6}
    study = fitted(measured(creeping))
    deployed = study.held_out.deployed
    assert deployed.among_measured is not None
    end = 150.0 * COUNT
    new = poses_of(np.random.default_rng(9).uniform(-1.2, 1.2, (50, 2)))
    later = replace(new, t=np.linspace(end, 1.5 * end, 50), running=np.linspace(end, 1.5 * end, 50))
    goes_on = solve_equilibrium(world(creeping), later).tcp
    off = np.linalg.norm(solve_equilibrium(as_deployed(study.model), new).tcp - goes_on, axis=1)
    true = float(np.sqrt((off**2).mean()))
    assert deployed.among_measured.rms < 0.5 * true
    assert 1.5 * deployed.among_measured.rms < deployed.now.rms < 1.1 * true
    assert "among_measured" in deployed.as_json()


@pytest.mark.parametrize(
    ("values", "names"),
    [({}, ()), ({"drift.joint1.A_rad": 0.05}, (DRIFT,)), ({"session.joint1.step2_rad": 0.04}, (SESSION,))],
)
def test_what_stands_or_follows_its_law_does_not_go_on(values: dict[str, float], names: tuple[str, ...]) -> None:
    """A law is known less well from its first half than from all of it, and a step only from what follows it."""
    deployed = fitted(measured(values), *names).held_out.deployed
    assert deployed.among_measured is None


@pytest.mark.long
def test_a_joint_that_warms_up_in_one_session_follows_the_time_since_power_on(tmp_path: Path) -> None:
    """Cold and warm poses count alike, as the daemon predicts them; where the time is not known is said beside it."""
    data = measured({"drift.joint1.A_rad": 0.05})
    alone = replace(data.poses, session=None, power_cycle=None)
    study = fitted(replace(data, poses=alone), DRIFT)
    assert set(study.model.state.warming) == {DRIFT}
    assert len(rows_as_deployed(study.model, alone)) == COUNT
    deployed, shown = study.held_out.deployed, study.held_out.error
    assert deployed.now.rms == pytest.approx(shown.rms, rel=0.01)
    assert deployed.otherwise is None
    assert deployed.time_unknown.rms > 3.0 * deployed.now.rms
    path = tmp_path / "model.toml"
    study.save(path)
    read = load_model(path)
    assert read.state.warming == pytest.approx(study.model.state.warming)
    new = poses_of(np.random.default_rng(9).uniform(-1.2, 1.2, (50, 2)))
    for running in (0.0, 600.0, 1e5):
        now = replace(new, t=np.full(50, running))
        goes_on = solve_equilibrium(world({"drift.joint1.A_rad": 0.05}), now).tcp
        off = np.linalg.norm(solve_equilibrium(as_deployed_at(read, now), now).tcp - goes_on, axis=1)
        assert off.max() < 8.0 * NOISE, "the cold arm and the warm one"


def test_several_sessions_follow_no_time() -> None:
    """Times since the first power-on are none since the last."""
    state = fitted(measured({"drift.joint1.A_rad": 0.05}), DRIFT).model.state
    assert not state.warming


def test_a_drift_with_temperature_follows_it_only_where_it_is_known() -> None:
    """The daemon's thermal model has it; a file of poses without `temp_c` has not, and the kept state counts."""
    law = {"drift.joint1.A_rad": 0.05, "drift.joint1.c_rad_per_K": 1e-3}
    model = world(law).with_state(StateAfterSession({DRIFT: "last"}, {"offsets.joint1.theta_rad": 0.07}, {DRIFT: 0.07}))
    pose, t = poses_of([0.1, 0.2]), np.array([600.0])
    warm = replace(pose, t=t, temperature=np.array([30.0]), warmed=np.array([10.0]))
    assert followed_parts(model, replace(pose, t=t)) == {}
    expected = 0.05 * (1.0 - np.exp(-600.0 / 1800.0)) + 0.01 - 0.07
    assert followed_parts(model, warm) == pytest.approx({"offsets.joint1.theta_rad": expected})
    assert not any(of_a_session(effect) for effect in as_deployed_at(model, replace(pose, t=t)).effects)


def test_what_remembers_leaves_its_mean_where_its_end_predicts_no_better() -> None:
    """Creep that forgets in a minute: the last pose says nothing of later ones."""
    creep = "creep@joint2"
    model = replace(world({}), effects=(*world({}).effects, *effects_at(load_arm(ARM), creep)))
    model = model_of(model.arm, model.effects, {"creep.joint2.k_rad_per_Nm": 0.05, "creep.joint2.T_s": 60.0})
    data = measured({})
    tcp = solve_equilibrium(model, data.poses).tcp + np.random.default_rng(4).normal(0.0, NOISE, (COUNT, 3))
    state = fitted(data.with_tcp(tcp), creep).model.state
    assert state.carried == {creep: "mean"}


def test_without_an_order_the_mean_is_deployed() -> None:
    """Nobody knows which pose was the last; every pose is then one of its state."""
    data = measured({"session.joint1.step2_rad": 0.04}, numbered=False)
    study = fitted(data, SESSION)
    assert study.model.state.carried == {SESSION: "mean"}
    assert study.model.state.offsets["offsets.joint1.theta_rad"] == pytest.approx(0.04 * 2 / 3, abs=1e-3)
    assert len(rows_as_deployed(study.model, data.poses)) == COUNT


def test_a_model_of_lasting_effects_has_one_error() -> None:
    """In the session and as deployed it is the same, pose by pose."""
    study = fitted(measured({}))
    assert study.held_out.deployed.otherwise is None
    assert study.held_out.deployed.now.rms == study.held_out.error.rms


@pytest.mark.long
def test_the_state_is_in_every_file_that_leaves(tmp_path: Path) -> None:
    """A prediction at other poses and an exported robot file have the zero of the warm arm."""
    data = measured({"drift.joint1.A_rad": 0.05})
    study = fitted(data, DRIFT)
    model, poses, out = tmp_path / "model.toml", tmp_path / "poses.csv", tmp_path / "out.csv"
    study.save(model)
    deployed = as_deployed(load_model(model))
    poses.write_text("pose,q1_deg,q2_deg\n1,10,20\n2,-30,40\n")
    stdout_of("predict", str(model), str(poses), "-o", str(out))
    x = np.loadtxt(out, delimiter=",", skiprows=1)
    q = poses_of(np.radians([[10.0, 20.0], [-30.0, 40.0]]))
    np.testing.assert_allclose(x[:, 3:6] * 1e-3, solve_equilibrium(deployed, q).tcp, atol=1e-8)
    exported = tmp_path / "arm.xml"
    said = stdout_of("arm", "export", str(model), "-o", str(exported))
    assert DRIFT in said
    assert exported.read_text() == mjcf(deployed).text
    assert exported.read_text() != mjcf(replace(deployed, values=0.0 * deployed.values)).text


def test_the_error_as_deployed_says_of_how_many_poses_it_is() -> None:
    """It is of the warm poses alone: beside that of a step before, of all poses, it would show a fall of its own."""
    plain, warm = (fitted(measured({"drift.joint1.A_rad": 0.05}), *names) for names in ((), (DRIFT,)))
    deployed = warm.held_out.deployed
    assert deployed.otherwise is not None
    held = len(rows_as_deployed(warm.model, warm.data.poses))
    assert 0 < held < COUNT
    assert (plain.file.history[-1].deployed_poses, warm.file.history[-1].deployed_poses) == (None, held)
    assert deployed.as_json()["poses"] == held
    story = story_of_file(warm.file)
    assert f"at {held} poses" in str(dict(story.facts)["as deployed"])


def test_a_diagnosis_compares_the_deployed_models_at_equal_poses() -> None:
    """Before: the error without a drift was of all poses, cold ones included, and that with it of the warm ones."""
    study = fitted(measured({"drift.joint1.A_rad": 0.05}))
    report = study.diagnose()
    first = report.first
    assert first.deployed is not None
    rows = rows_as_deployed(first.fit.model, report.diagnosis.data.poses)
    assert len(rows) < len(report.diagnosis.data)
    blocks = confirm(report.diagnosis).blocks
    assert first.deployed_without.rms == pytest.approx(error_stats(deployed_residual(blocks)[rows]).rms)
    assert first.deployed_without.rms != pytest.approx(report.deployed.now.rms)
