"""A dataset by its name, USER/DATASET: from LeRobot's cache, from the Hub; and what a checkup leaves for its card."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")

from lrm_ident.measuring.recordings.lerobot_hub import dataset_folder, lerobot_home
from lrm_math.errors import LrmError
from tests.support.commands import stderr_of, stdout_of
from tests.support.teleoperation import ailing_arm, recorded, sound_arm
from validation.lerobot_dataset import write_dataset


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
