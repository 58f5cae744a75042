"""A comparison as Foxglove's scenes, read back by the reader of mcap."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lrm_ident.report.plots.comparison_scene import ENLARGED, topic_of
from lrm_math.model.model_file import HistoryTable
from tests.support.commands import part_of_example, run_command

STEPS = ("0_nominal", "1_fit", "2_add_servo_gain@joint3")
reader = pytest.importorskip("mcap.reader", reason="mcap is not installed (lrm-arm[mcap])")


@pytest.mark.long
def test_arm_and_arrows_of_every_pose_are_read_back(tmp_path: Path) -> None:
    data, model, file = part_of_example(tmp_path, 60), tmp_path / "model.toml", tmp_path / "scene.mcap"
    assert run_command("fit", data, "-o", tmp_path / "fitted.toml")[0] == 0
    assert run_command("add", tmp_path / "fitted.toml", data, "servo_gain@joint3", "-o", model)[0] == 0
    said = tmp_path / "compared.json"
    code, _, complaint = run_command("compare", model, data, "--mcap", file, "--json", said)
    assert (code, complaint) == (0, "")
    scenes: dict[str, list[dict]] = {}
    with file.open("rb") as opened:
        for schema, channel, message in reader.make_reader(opened).iter_messages():
            assert schema.name == "foxglove.SceneUpdate"
            scenes.setdefault(channel.topic, []).append(json.loads(message.data)["entities"][0])
    count = len(np.genfromtxt(data, delimiter=",", names=True))
    assert {topic: len(all_) for topic, all_ in scenes.items()} == dict.fromkeys(
        ("/arm", *(f"/errors/{name}" for name in STEPS)), count
    )
    rms = {}
    for name in STEPS:
        arrows = [scene["arrows"][0] for scene in scenes[f"/errors/{name}"]]
        lengths = np.array([arrow["shaft_length"] + arrow["head_length"] for arrow in arrows]) / ENLARGED
        rms[name] = float(np.sqrt((lengths**2).mean()))
        for arrow, arm in zip(arrows, scenes["/arm"], strict=True):
            assert arrow["pose"]["position"] == arm["lines"][0]["points"][-1]
            turn = [arrow["pose"]["orientation"][axis] for axis in "xyzw"]
            assert np.linalg.norm(Rotation.from_quat(turn).apply([1.0, 0.0, 0.0])) == pytest.approx(1.0)
    assert rms["2_add_servo_gain@joint3"] <= rms["1_fit"] < rms["0_nominal"]
    colours = {scenes[f"/errors/{name}"][0]["arrows"][0]["color"]["r"] for name in STEPS}
    assert len(colours) == 3


def test_a_step_is_a_topic_without_its_rivals() -> None:
    old = {"step": "add backlash@joint2, or hysteresis@joint2: these data cannot tell"}
    name = HistoryTable.model_validate({**old, "fit_rms_mm": 1.0, "effects": [], "parameters": {}}).name
    assert topic_of(2, str(name)) == "/errors/2_add_backlash@joint2"
