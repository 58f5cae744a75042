"""Model texts of strangers: refused in a process of their own, in one line, and nothing of them is left."""

from __future__ import annotations

import os
import re
import threading
from dataclasses import replace
from pathlib import Path
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.errors import FileError, LrmError
from lrm_math.toml_file import parse_toml
from lrmd.api import model_reload
from lrmd.api.model_reload import ActiveModel
from lrmd.api.model_trial import check_in_trial
from lrmd.config import Config, load_config
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import deploy_file
from lrmd.persistence.deployed_models import KEPT, DeployedVersions
from lrmd.ramp.shared_memory import SharedRecords
from tests.conftest import ROOT
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.sweep import soak

pytestmark = pytest.mark.long

MODEL = (ROOT / "tests" / "models" / "thesis-table-b2-option-1.toml").read_text(encoding="utf-8")
EFFECTS = MODEL[MODEL.index("effects = [") : MODEL.index("]", MODEL.index("effects = [")) + 1]


def with_effects(*names: object) -> str:
    return MODEL.replace(EFFECTS, f"effects = {list(names)!r}")


def of_arm(name: str) -> str:
    return MODEL.replace('"lrm-rover"', f'"{name}"')


HOSTILE = {
    "dotted keys": (".".join("a" * 60_000) + " = 1", "a key of more than 32 parts"),
    "nested arrays": ("a = " + "[" * 100_000, "nest too deeply"),
    "many tables": ("".join(f"[a{i}]\n" for i in range(100_000)), "takes more than 64 MB of memory"),
    "a device as its arm": (of_arm("/dev/zero"), "no arm of this daemon's"),
    "20 000 effects of one name": (with_effects(*["compliance"] * 20_000), "should have at most 1000 items"),
    "900 effects of one name": (with_effects(*["compliance"] * 900), "named twice"),
    "numbers for effects": (with_effects(*[1] * 200_000), "should be"),
    "a long name": (with_effects("x" * 900_000), "unknown effect"),
}


LIKE_ANOTHER = ("nested arrays", "20 000 effects of one name", "numbers for effects")
"""Refused where another of these is."""


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return replace(load_config(CONFIG), state=tmp_path)


@pytest.fixture
def active(config: Config) -> ActiveModel:
    return ActiveModel(config, SharedRecords.create())


def files(config: Config) -> list[str]:
    """Names in the folder of the versions."""
    folder = DeployedVersions(config.state).folder
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


@pytest.mark.parametrize("name", [*(name for name in HOSTILE if name not in LIKE_ANOTHER), *soak(*LIKE_ANOTHER)])
def test_a_hostile_text_is_one_line_and_leaves_nothing(name: str, config: Config, active: ActiveModel) -> None:
    text, said = HOSTILE[name]
    for _ in range(5):  # a machine that is busy has no time to check it, and says so
        with pytest.raises(LrmError) as caught:
            active.deploy(text)
        if "ask again" not in str(caught.value):
            break
    assert re.search(said, str(caught.value))
    assert "\n" not in str(caught.value)
    assert str(config.state) not in str(caught.value), "the sender has no such file"
    assert len(str(caught.value)) <= 1100
    assert files(config) == []
    assert active.deployed.sha256 == ""


def test_no_answer_tells_whether_a_file_exists(config: Config, active: ActiveModel) -> None:
    """Neither by the arm's name nor by that of a file with effects of one's own."""
    own = '\n[provenance]\ndata = ""\ndata_sha256 = ""\nposes = 1\ntool = ""\ndate = ""\neffects_file = "{}"\n'
    for text in (of_arm("{}"), with_effects("magic").split("[provenance]")[0] + own):
        said = set()
        for path in ("/dev/null", "/dev/nope"):
            with pytest.raises(LrmError) as caught:
                active.deploy(text.replace("{}", path))
            said.add(str(caught.value).replace(path, "PATH"))
        assert len(said) == 1, said
    assert files(config) == []


def test_a_file_of_the_administrator_may_name_an_arm_by_its_path(config: Config, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_bytes((ROOT / "config" / "arms" / "lrm-rover.toml").read_bytes())
    model = tmp_path / "model.toml"
    model.write_text(of_arm("own.toml"))
    check_in_trial(config, model)
    assert deploy_file(config, model).sha256


def test_a_stopped_deployment_leaves_none(config: Config, active: ActiveModel, monkeypatch: pytest.MonkeyPatch) -> None:
    for error in (KeyboardInterrupt, MemoryError, RecursionError, SystemExit, ZeroDivisionError, LrmError):
        for owner, step in (model_reload, "check_in_trial"), (model_reload, "load_checked"), (DeployedVersions, "save"):
            with monkeypatch.context() as broken:
                broken.setattr(model_reload, "check_in_trial", mock.Mock())  # half a second for each process
                broken.setattr(owner, step, mock.Mock(side_effect=error("no")))
                with pytest.raises(error):
                    active.deploy(MODEL)
            assert files(config) == []


def test_a_second_deployment_is_told_that_there_is_one(active: ActiveModel, monkeypatch: pytest.MonkeyPatch) -> None:
    checking, go_on = threading.Event(), threading.Event()
    monkeypatch.setattr(model_reload, "check_in_trial", lambda *_: (checking.set(), go_on.wait(30)))
    first = threading.Thread(target=active.deploy, args=(MODEL,))
    first.start()
    assert checking.wait(30)
    for again in (lambda: active.deploy(MODEL), active.load, active.undo):
        with pytest.raises(RequestError) as refused:
            again()
        assert (refused.value.code, refused.value.retryable) == ("busy", True)
    go_on.set()
    first.join()
    assert active.deployed.sha256


def test_a_trial_holds_no_descriptor_of_its_parent(config: Config) -> None:
    """A device that only a descriptor of the parent leads to cannot be read in the trial."""
    reading, writing = os.pipe()
    os.set_inheritable(reading, True)
    try:
        with pytest.raises(LrmError, match="No such file"):
            check_in_trial(config, Path(f"/proc/self/fd/{reading}"))
    finally:
        os.close(reading)
        os.close(writing)


@given(deployments=st.lists(st.booleans(), max_size=40))
def test_stack_and_files_agree_and_are_bound(tmp_path_factory: pytest.TempPathFactory, deployments: list[bool]) -> None:
    """A deployment (True) or an undo: what an undo goes back to is there, and the last one always is."""
    kept = DeployedVersions(tmp_path_factory.mktemp("state"))
    history: list[str] = []
    for number, deployed in enumerate(deployments):
        if deployed:
            with kept.new(f"text {number}") as path:
                history.append(path.name)
        elif kept.stack.versions:
            with kept.undone():
                history.pop()
        versions = list(kept.stack.versions)
        present = {path.name for path in kept.folder.glob("*.toml")} if kept.folder.exists() else set()
        assert len(present) <= KEPT
        assert set(versions) <= present
        assert versions == history[len(history) - len(versions) :], "in their order"
        assert len(versions) >= min(2, len(history)) or not deployed


def test_an_endless_file_is_not_read() -> None:
    with pytest.raises(FileError, match="more than 32 MB"):
        parse_toml(Path("/dev/zero"))
