"""LeRobot: rests of a v3 dataset with joint feedback, a dataset by its name, and what a checkup leaves for its card."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.measuring.recordings.lerobot_hub import dataset_folder, lerobot_home
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from tests.support.commands import stderr_of, stdout_of
from validation.encoder_checkup.teleoperation import ailing_arm, recorded, sound_arm, write_dataset

FPS, REST_S, MOVE_S = 30, 2.0, 1.0


@pytest.fixture(scope="module")
def so101() -> Arm:
    return load_arm("so101")


def written(folder: Path, arm: Arm, poses: Array, droop_deg: Array) -> Path:
    """Two episodes in which the arm rests at every pose (R, n) in deg, its servos `droop_deg` (R, n) off."""
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra 'lerobot')")
    parquet = pytest.importorskip("pyarrow.parquet")
    rng = np.random.default_rng(0)
    names = [*(f"{joint.name}.pos" for joint in arm.joints), "gripper.pos"]
    rows: list[dict[str, object]] = []
    for episode, half in enumerate(np.array_split(np.arange(len(poses)), 2)):
        frame = 0
        for before, pose in zip([half[0], *half[:-1]], half, strict=True):
            for step in range(int(FPS * MOVE_S)):
                share = (step + 1) / (FPS * MOVE_S)
                q = poses[before] + share * (poses[pose] - poses[before])
                rows.append(row_of(q, q + droop_deg[pose], frame, episode))
                frame += 1
            for _ in range(int(FPS * REST_S)):
                read = poses[pose] + droop_deg[pose] + rng.normal(0, 0.05, poses.shape[1])
                rows.append(row_of(poses[pose], read, frame, episode))
                frame += 1
    (folder / "meta").mkdir(parents=True)
    features = {name: {"dtype": "float32", "shape": [6], "names": names} for name in ("action", "observation.state")}
    info = {"codebase_version": "v3.0", "fps": FPS, "robot_type": "so101_follower", "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    (folder / "data" / "chunk-000").mkdir(parents=True)
    half = len(rows) // 2
    for number, part in enumerate((rows[:half], rows[half:])):
        table = pyarrow.Table.from_pylist(part)
        parquet.write_table(table, folder / "data" / "chunk-000" / f"file-{number:03d}.parquet")
    return folder


def row_of(command: Array, read: Array, frame: int, episode: int) -> dict[str, object]:
    return {
        "action": [*command.tolist(), 10.0],
        "observation.state": [*read.tolist(), 11.0],
        "timestamp": frame / FPS,
        "episode_index": episode,
    }


def test_rests_are_found_with_their_feedback(so101: Arm, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    poses, droop = rng.uniform(-60, 60, (12, 5)), rng.normal(0, 1.0, (12, 5))
    folder = written(tmp_path / "dataset", so101, poses, droop)
    out = tmp_path / "poses.csv"
    said = stdout_of("import", "lerobot", folder, "--arm", "so101", "-o", out)
    assert "12 stops of 2 episodes" in said
    read = load_poses(out, so101)
    np.testing.assert_allclose(np.degrees(read.q), poses, atol=0.02)
    assert read.session is not None
    table = np.genfromtxt(out, delimiter=",", names=True)
    feedback = np.stack([table[f"q{i}_meas_deg"] for i in range(1, 6)], axis=1)
    np.testing.assert_allclose(feedback, poses + droop, atol=0.05)
    assert "feedback_sd_deg = 0.0" in out.with_suffix(".toml").read_text()


def test_what_is_no_such_dataset(so101: Arm, tmp_path: Path) -> None:
    folder = written(tmp_path / "dataset", so101, np.zeros((2, 5)), np.zeros((2, 5)))
    out = tmp_path / "poses.csv"
    assert "no joint 'joint1'" in stderr_of("import", "lerobot", folder, "--arm", "ur5", "-o", out)
    assert "never rests for 60 s" in stderr_of("import", "lerobot", folder, "--dwell", "60", "-o", out)
    info = folder / "meta" / "info.json"
    info.write_text(info.read_text().replace("v3.0", "v1.6"))
    assert "v1.6; v2.1 or v3.0" in stderr_of("import", "lerobot", folder, "-o", out)
    assert "no such file" in stderr_of("import", "lerobot", tmp_path / "none", "-o", out)
    assert not out.exists()


pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "home"


def hub_with(fetch: Any) -> Any:
    module = ModuleType("huggingface_hub")
    module.__dict__["snapshot_download"] = fetch
    return patch.dict(sys.modules, {"huggingface_hub": module})


@pytest.mark.long
def test_a_checkup_by_name_ends_with_a_code_by_its_findings_and_writes_a_card(home: Path, tmp_path: Path) -> None:
    arm, _ = ailing_arm("slip", np.random.default_rng(5))
    write_dataset(home / "me" / "ailing", recorded(arm, np.random.default_rng(6)), "v3.0")
    write_dataset(
        home / "me" / "sound", recorded(sound_arm(np.random.default_rng(1)), np.random.default_rng(2)), "v3.0"
    )
    assert "Command and encoder cannot show" in stdout_of(
        "checkup", "me/ailing", "--card", tmp_path / "card.md", code=1
    )
    card = (tmp_path / "card.md").read_text()
    assert card.startswith("## Check of the arm\n")
    assert "jumps by" in card
    stdout_of("checkup", "me/sound", "--card", tmp_path / "card.md")
    assert "No joint has a fault that encoders show." in (tmp_path / "card.md").read_text()


def test_a_folder_comes_first_then_the_cache_then_what_the_hub_gave(home: Path, tmp_path: Path) -> None:
    kept = home / "hub" / "datasets--you--arm" / "snapshots" / "abc"
    for path in (kept / "meta" / "info.json", home / "me" / "arm" / "meta" / "info.json"):
        path.parent.mkdir(parents=True)
        path.write_text("{}")
    (kept / "data").mkdir()
    assert dataset_folder(Path("me/arm")) == home / "me" / "arm"
    assert dataset_folder(Path("you/arm")) == kept
    (tmp_path / "me" / "arm").mkdir(parents=True)
    assert dataset_folder(Path("me/arm")) == Path("me/arm")
    assert dataset_folder(tmp_path / "none") == tmp_path / "none"


def test_the_hub_is_asked_for_no_more_than_is_read(home: Path, tmp_path: Path) -> None:
    asked: list[dict[str, Any]] = []

    def fetch(name: str, **options: Any) -> str:
        asked.append({"name": name, **options})
        return str(tmp_path / "fetched")

    with hub_with(fetch):
        assert dataset_folder(Path("you/arm")) == tmp_path / "fetched"
        assert dataset_folder(Path("you/arm"), videos=True) == tmp_path / "fetched"
    assert [each["name"] for each in asked] == ["you/arm"] * 2
    assert [each["allow_patterns"] for each in asked] == [["meta/*", "data/*"], ["meta/*", "data/*", "videos/*"]]
    assert asked[0]["repo_type"] == "dataset"
    assert asked[0]["cache_dir"] == home / "hub"


def test_what_cannot_be_had_is_one_line(home: Path) -> None:
    def refused(*_: Any, **__: Any) -> str:
        raise OSError("404 Client Error.\n\nRepository Not Found")

    with hub_with(refused), pytest.raises(LrmError, match=r"cannot be fetched \(404 Client Error\. Repository Not"):
        dataset_folder(Path("you/none"))
    with patch.dict(sys.modules, {"huggingface_hub": None}):
        said = stderr_of("checkup", "you/none")
    assert f"no dataset of this name in {home}; give its folder, or, for one on the Hub: pip install" in said


def test_the_cache_is_where_lerobot_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HF_LEROBOT_HOME", "HF_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert lerobot_home() == Path("~/.cache/huggingface/lerobot").expanduser()
    monkeypatch.setenv("HF_HOME", "/data/hf")
    assert lerobot_home() == Path("/data/hf/lerobot")
