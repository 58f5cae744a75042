"""A joint whose command and encoder disagree is named: reversed, swapped, frozen, a full turn off, on another scale."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.measuring.recordings.encoder_checkup import MATTERS, checkup
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from tests.support.commands import run_command, stderr_of, stdout_of
from validation.lerobot_dataset import Recording, write_dataset

FPS, RESTS, REST_FRAMES = 30, 24, 40
ARM = load_arm("so101")
JOINTS = [joint.name for joint in ARM.joints]


def recording(seed: int = 0) -> LeRobotFrames:
    """Rests at random poses and sudden moves between them; an encoder that flickers by 0.03 deg."""
    rng = np.random.default_rng(seed)
    low, high = (0.6 * np.array([getattr(joint, name) for joint in ARM.joints]) for name in ("lower", "upper"))
    command = np.repeat(rng.uniform(low, high, (RESTS, ARM.dof)), REST_FRAMES, axis=0)
    state = command + rng.normal(0.0, np.radians(0.03), command.shape)
    t = np.arange(len(command)) / FPS
    return LeRobotFrames(command, state, t, np.zeros(len(command), dtype=np.int64))


def with_state(frames: LeRobotFrames, joint: int, change: Callable[[Array], Array]) -> LeRobotFrames:
    state = frames.feedback.copy()
    state[:, joint] = change(state[:, joint])
    return replace(frames, feedback=state)


def past_the_seam(angle: Array) -> Array:
    return np.where(angle > np.radians(40.0), angle - 2.0 * np.pi, angle)


KINDS: dict[str, tuple[str, Callable[[Array], Array]]] = {
    "reversed": ("reversed", lambda q: -q),
    "reversed about another zero": ("reversed", lambda q: 0.4 - q),
    "a full turn at some rests": ("full turn", past_the_seam),
    "a full turn everywhere": ("full turn", lambda q: q + 2.0 * np.pi),
    "frozen": ("frozen", lambda q: 0.0 * q + 0.3),
    "frozen, but for a count that flickers": ("frozen", lambda q: 0.3 + np.radians(0.05) * np.sign(np.sin(1e3 * q))),
    "frozen from the middle on": ("frozen", lambda q: np.where(np.arange(len(q)) < len(q) // 2, q, q[len(q) // 2])),
    "radians in one joint": ("unit", lambda q: np.radians(q)),
    "a gain": ("gain", lambda q: 1.3 * q),
    "a small gain": ("gain", lambda q: 0.97 * q),
    "something else": ("unexplained", lambda q: q + np.radians(3.0) * np.sin(11.0 * q)),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("joint", [0, 3])
def test_each_kind_is_named_at_its_joint_alone(kind: str, joint: int) -> None:
    name, change = KINDS[kind]
    found = checkup(with_state(recording(), joint, change), ARM, 0.5)
    assert {one.joint for one in found.findings} == {joint}
    assert name in {one.cause for one in found.findings}
    assert name == "unexplained" or found.after.max() < MATTERS


@pytest.mark.parametrize(("joint", "factor"), [(1, np.pi / 180.0), (3, 4096.0 / 360.0)])
def test_commands_in_another_unit_are_told_from_an_encoder_that_stands_still(joint: int, factor: float) -> None:
    frames = recording()
    command = frames.command.copy()
    command[:, joint] *= factor
    found = checkup(replace(frames, command=command), ARM, 0.5)
    assert [(one.cause, one.joint) for one in found.findings if one.cause != "offset"] == [("unit", joint)]


@pytest.mark.parametrize("order", [(1, 0, 2, 3, 4), (0, 3, 2, 1, 4), (1, 2, 0, 3, 4)])
def test_swapped_joints_are_named_with_each_other(order: tuple[int, ...]) -> None:
    frames = recording()
    found = checkup(replace(frames, feedback=frames.feedback[:, order]), ARM, 0.5)
    swapped = {one.joint: one.misread.other for one in found.findings if one.misread}
    assert {one.cause for one in found.findings} == {"swapped"}
    assert all(order[other] == joint for joint, other in swapped.items() if other is not None)
    assert set(swapped) == {joint for joint in range(5) if order[joint] != joint}


@pytest.mark.parametrize("seed", range(5))
def test_a_recording_without_faults_has_no_finding(seed: int) -> None:
    assert checkup(recording(seed), ARM, 0.5).findings == ()


def test_an_arm_beyond_its_limits_is_told_from_one_a_full_turn_away() -> None:
    frames = recording()
    shift = np.radians(70.0) * (np.arange(ARM.dof) == 2)
    beyond = replace(frames, command=frames.command + shift, feedback=frames.feedback + shift)
    assert [(one.cause, one.joint) for one in checkup(beyond, ARM, 0.5).findings] == [("limits", 2)]
    turned = [past_the_seam(angles[:, 4]) for angles in (frames.command, frames.feedback)]
    both = replace(frames, command=frames.command.copy(), feedback=frames.feedback.copy())
    both.command[:, 4], both.feedback[:, 4] = turned
    assert [(one.cause, one.joint) for one in checkup(both, ARM, 0.5).findings] == [("full turn", 4)]


def test_frames_without_a_number_are_left_out_and_named() -> None:
    frames = with_state(recording(), 2, lambda q: np.where(np.arange(len(q)) // 30 == 4, np.nan, q))
    found = checkup(frames, ARM, 0.5)
    assert [(one.cause, one.joint, one.frames) for one in found.findings] == [("not read", 2, tuple(range(120, 150)))]
    assert np.isfinite(found.after).all()


def written(folder: Path, frames: LeRobotFrames, names: list[str], unit: float = 1.0) -> Path:
    """A dataset whose columns have these names, those of the arm's joints over and over."""
    pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra 'lerobot')")
    columns = [next((j for j, joint in enumerate(JOINTS) if joint in name), None) for name in names]
    action, state = (
        np.stack([np.full(len(angles), 30.0) if j is None else angles[:, j] * unit for j in columns], axis=1)
        for angles in (np.degrees(frames.command), np.degrees(frames.feedback))
    )
    return write_dataset(folder, Recording(action, state, frames.t, frames.episode), "v3.0", names)


@pytest.mark.parametrize("before", ["", "main_", "arm_", "left_", "right_"])
def test_names_of_joints_with_what_stands_before_them(before: str, tmp_path: Path) -> None:
    names = [f"{before}{name}.pos" for name in [*JOINTS, "gripper"]] + ["x.vel"]
    said = stdout_of("checkup", written(tmp_path / "data", recording(), names))
    assert "no joint is off its command" in said


def test_of_two_arms_one_is_asked_for(tmp_path: Path) -> None:
    names = [f"{side}_{name}.pos" for side in ("left", "right") for name in JOINTS]
    folder = written(tmp_path / "data", recording(), names)
    said = stderr_of("checkup", folder)
    assert "--prefix left_ or --prefix right_" in said
    assert "no joint is off" in stdout_of("checkup", folder, "--prefix", "right_")
    assert "24 stops" in stdout_of("import", "lerobot", folder, "--prefix", "left_", "-o", tmp_path / "poses.csv")


@pytest.mark.long
def test_other_units_of_all_angles_are_refused_and_the_remedy_helps(tmp_path: Path) -> None:
    folder = written(tmp_path / "rad", recording(), JOINTS, np.radians(1.0))
    for command in (("checkup", folder), ("import", "lerobot", folder, "-o", tmp_path / "poses.csv")):
        assert "look like radians" in stderr_of(*command)
        assert "24 stops" in stdout_of(*command, "--angle-unit", "rad")
    counts = recording()
    shifted = replace(counts, command=counts.command + np.pi, feedback=counts.feedback + np.pi)
    assert "counts of encoders" in stderr_of("checkup", written(tmp_path / "n", shifted, JOINTS, 4096 / 360))


@pytest.mark.parametrize(("kind", "said"), [("koch_follower", "is it --arm koch?"), ("so101_follower", "")])
def test_an_arm_that_the_dataset_does_not_name_is_asked_about(kind: str, said: str, tmp_path: Path) -> None:
    """Their joints have the same names, and its poses may be within the limits of both."""
    folder = written(tmp_path / "data", recording(), JOINTS)
    about = folder / "meta" / "info.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"robot_type": kind}))
    _, out, err = run_command("checkup", folder, "--arm", "so101")
    heard = " ".join(f"{out} {err}".split())
    assert said in heard
    assert said or "is it --arm" not in heard


def test_import_passes_the_same_gate(tmp_path: Path) -> None:
    frames, out = recording(), tmp_path / "poses.csv"
    beyond = replace(frames, command=frames.command + 1.2, feedback=frames.feedback + 1.2)
    said = stderr_of("import", "lerobot", written(tmp_path / "beyond", beyond, JOINTS), "-o", out)
    assert "beyond its limits" in said
    assert not out.exists()
    holes = with_state(frames, 1, lambda q: np.where(np.arange(len(q)) // 30 == 4, np.nan, q))
    stdout_of("import", "lerobot", written(tmp_path / "holes", holes, JOINTS), "-o", out)
    assert np.isfinite(np.genfromtxt(out, delimiter=",", skip_header=1)).all()
