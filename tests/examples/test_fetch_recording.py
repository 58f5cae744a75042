"""The MCAP file of a fetch, read back by the reader of mcap."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples.fetch.places import HOME, stones
from examples.fetch.recording import recorded, thinned, true_tips
from examples.fetch.world import ARM_FILE, hidden_truth
from lrm_math.arm.arm_file import load_arm
from lrm_math.collision.scene import Scene
from validation import synthetic

reader = pytest.importorskip("mcap.reader", reason="mcap is not installed (lrm-arm[mcap])")

pytestmark = pytest.mark.long


def test_joints_tip_scene_and_events_of_a_run_are_read_back(tmp_path: Path) -> None:
    t = np.arange(0.0, 12.0, 6.5e-3)
    q = np.array(HOME) + 0.2 * np.sin(t)[:, None]
    some, (arm, truth), lying = thinned(t), hidden_truth(1), stones(2, 1)
    assert 0.15 < np.diff(t[some]).mean() < 0.25
    t, q = t[some], q[some]
    tips = true_tips(arm, truth, t, q, [(3.0, 0.06), (8.0, 0.0)], [(6.0, (2.0, 0.0, -9.6))])
    path = tmp_path / "fetch.mcap"
    path.write_bytes(recorded(ARM_FILE, t, q, tips, [(2.0, "touch_down: reached"), (5.0, "in the basket")], lying))
    found: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    names: dict[str, str] = {}
    for schema, channel, message in reader.make_reader(io.BytesIO(path.read_bytes())).iter_messages():
        found.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
        names[channel.topic] = schema.name
    assert names == {
        "/joint_states": "sensor_msgs/JointState", "/tip": "geometry_msgs/PointStamped",
        "/scene": "foxglove.SceneUpdate", "/stones": "foxglove.SceneUpdate", "/events": "foxglove.Log",
    }  # fmt: skip
    angles = np.array([said["position"] for _, said in found["/joint_states"]])
    assert np.array_equal(angles, q)
    assert np.array([at for at, _ in found["/joint_states"]]) == pytest.approx(1e9 * t, abs=1.0)
    read = np.array([[said["point"][axis] for axis in "xyz"] for _, said in found["/tip"]])
    assert np.array_equal(read, tips)
    k = int(np.searchsorted(t, 5.0))
    alone = synthetic.true_state(arm, truth, q[k : k + 1], 0.06, synthetic.Schedule(t[k : k + 1], np.ones(1), q[0]))
    assert read[k] == pytest.approx(alone.tcp_m[0], abs=1e-12)
    on_level = true_tips(arm, truth, t, q, [(3.0, 0.06), (8.0, 0.0)])
    assert np.array_equal(on_level[t < 6.0], tips[t < 6.0])
    assert (np.linalg.norm(on_level - tips, axis=1)[t > 6.0] > 1e-4).all()
    ends = [said["entities"][0]["lines"][0]["points"][-1] for _, said in found["/scene"]]
    drawn = Scene.of(load_arm("lrm-rover")).frames(q)[:, -1, :3, 3]
    assert np.array([[end[axis] for axis in "xyz"] for end in ends]) == pytest.approx(drawn, abs=1e-9)
    (_, standing) = found["/stones"][0]
    assert len(standing["entities"][0]["spheres"]) == 2
    assert [(at / 1e9, said["message"]) for at, said in found["/events"]] == [
        (2.0, "touch_down: reached"), (5.0, "in the basket")
    ]  # fmt: skip
