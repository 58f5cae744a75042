"""A checkup by the encoders alone: one hidden cause is named at its joint, a sound arm has no name."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra 'lerobot')")

from lrm_ident.cli.groups.checkup_report import WORDS
from lrm_ident.measuring.recordings.encoder_checkup import Cause, EncoderFinding, checkup
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames, read_frames
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from tests.support.commands import stderr_of, stdout_of
from validation.lerobot_dataset import VERSIONS, Recording, write_dataset
from validation.teleoperation import (
    CAUSES,
    FollowingArm,
    ailing_arm,
    recorded,
    sound_arm,
)

pytestmark = pytest.mark.long


def named(arm: FollowingArm, seed: int, version: str, folder: Path) -> tuple[EncoderFinding, ...]:
    """Effects named in a recording of an arm, through its files."""
    data = write_dataset(folder / "data", recorded(arm, np.random.default_rng([seed, 1])), version)
    return checkup(read_frames(data, load_arm("so101")), load_arm("so101"), 0.5).findings


@pytest.mark.parametrize("number", range(5))
def test_a_hidden_cause_is_named_at_its_joint(number: int, tmp_path: Path) -> None:
    cause = CAUSES[number]
    arm, joint = ailing_arm(cause, np.random.default_rng(number))
    found = named(arm, number, VERSIONS[number % 2], tmp_path)
    assert [(one.cause, one.joint) for one in found] == [(cause, joint)]


@pytest.mark.parametrize("size", [17.0, 2.0])
def test_a_leader_offset_is_found_with_its_size(size: float, tmp_path: Path) -> None:
    arm, joint = ailing_arm("offset", np.random.default_rng(3), size)
    (found,) = named(arm, 3, "v3.0", tmp_path)
    assert (found.cause, found.joint) == ("offset", joint)
    assert np.degrees(found.size) == pytest.approx(size, abs=0.15)
    assert found.sign == np.sign(arm.offset[joint])


@pytest.mark.parametrize("seed", range(3))
def test_a_sound_arm_has_no_name(seed: int, tmp_path: Path) -> None:
    assert named(sound_arm(np.random.default_rng(seed)), seed, "v2.1", tmp_path) == ()


def test_both_formats_read_alike(tmp_path: Path) -> None:
    made = recorded(sound_arm(np.random.default_rng(1)), np.random.default_rng(2))
    arm = load_arm("so101")
    old, new = (read_frames(write_dataset(tmp_path / version, made, version), arm) for version in VERSIONS)
    for name in ("command", "feedback", "t", "episode"):
        np.testing.assert_array_equal(getattr(old, name), getattr(new, name))
    np.testing.assert_allclose(np.degrees(new.feedback), made.state, atol=1e-4)


def test_the_command_names_it_in_words_and_changes_nothing(tmp_path: Path) -> None:
    arm, joint = ailing_arm("slip", np.random.default_rng(5))
    folder = write_dataset(tmp_path / "mine", recorded(arm, np.random.default_rng(6)), "v3.0")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    out = tmp_path / "out.json"
    said = " ".join(stdout_of("checkup", folder, "--json", out, code=1).split())
    assert f"{load_arm('so101').joints[joint].name} jumps by" in said
    assert "Command and encoder cannot show" in said
    (finding,) = json.loads(out.read_text())["findings"]
    assert finding["cause"] == "slip"
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("cause", WORDS)
def test_no_words_assume_a_leader_arm(cause: Cause) -> None:
    """A recording does not state what commanded the arm: a leader, a gamepad or a program."""
    assert "leader and follower" not in WORDS[cause]
    assert "both" not in WORDS[cause].lower().replace("check both", "")


def test_what_cannot_be_checked_is_one_line(tmp_path: Path) -> None:
    made = recorded(sound_arm(np.random.default_rng(1)), np.random.default_rng(2))
    folder = write_dataset(tmp_path / "mine", made, "v3.0")
    assert "no joint 'joint1' among" in stderr_of("checkup", folder, "--arm", "ur5")
    assert "0 rests of 30 s or more; should be 12" in stderr_of("checkup", folder, "--dwell", "30")
    assert "no meta/info.json" in stderr_of("checkup", tmp_path)
    short = Recording(*(values[:200] for values in (made.action, made.state, made.t, made.episode)))
    assert "stop for a moment" in stderr_of("checkup", write_dataset(tmp_path / "short", short, "v2.1"))


def test_no_frames_at_all_is_one_line() -> None:
    empty = np.empty((0, 5))
    with pytest.raises(LrmError, match="0 rests"):
        checkup(LeRobotFrames(empty, empty, np.empty(0), np.empty(0, dtype=np.int64)), load_arm("so101"), 0.5)
