"""A comparison as Foxglove's scenes, read back by the reader of mcap."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lrm_ident.report.plots.comparison_scene import ENLARGED
from tests.support.commands import part_of_example, run_command

reader = pytest.importorskip("mcap.reader", reason="mcap is not installed (lrm-arm[mcap])")


def test_arm_and_arrows_of_every_pose_are_read_back(tmp_path: Path) -> None:
    data, model, file = part_of_example(tmp_path, 60), tmp_path / "model.toml", tmp_path / "scene.mcap"
    assert run_command("fit", data, "-o", model)[0] == 0
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
        ("/arm", "/errors/nominal", "/errors/model"), count
    )
    rms = {}
    for name in ("nominal", "model"):
        arrows = [scene["arrows"][0] for scene in scenes[f"/errors/{name}"]]
        lengths = np.array([arrow["shaft_length"] + arrow["head_length"] for arrow in arrows]) / ENLARGED
        rms[name] = float(np.sqrt((lengths**2).mean()))
        for arrow, arm in zip(arrows, scenes["/arm"], strict=True):
            assert arrow["pose"]["position"] == arm["lines"][0]["points"][-1]
            turn = [arrow["pose"]["orientation"][axis] for axis in "xyzw"]
            assert np.linalg.norm(Rotation.from_quat(turn).apply([1.0, 0.0, 0.0])) == pytest.approx(1.0)
    assert rms["model"] < rms["nominal"]
