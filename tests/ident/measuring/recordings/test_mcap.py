"""MCAP recordings as ROS 2 and Foxglove write them: rests, joint angles at them, and what is missing in a line."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lrm_math.arm.arm_file import load_arm
from tests.support.commands import run_command, stderr_of

pytest.importorskip("mcap_ros2", reason="mcap-ros2-support is not installed (lrm-arm[mcap])")

POSE = """std_msgs/Header header
geometry_msgs/Pose pose
================================================================================
MSG: geometry_msgs/Pose
Point position
Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
HEADER = """================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINT_STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
NAMES = [joint.name for joint in load_arm("so101").joints]
ANGLES = np.radians([[0, 0, 0, 0, 0], [15, -10, 12, 5, -8], [-12, 8, -15, 10, 20]])
TIPS = np.array([[0.3, 0.1, 0.2], [0.25, -0.1, 0.3], [0.1, 0.3, 0.15]])
BASE_TURN, BASE_PLACE = Rotation.from_euler("xyz", [0.3, -0.5, 1.1]), np.array([0.8, -0.3, 1.1])
RATE, REST_S, MOVE_S, BEGIN = 50.0, 3.0, 1.0, 1_700_000_000.0
Message = tuple[str, str, float, dict[str, Any]]


def messages() -> list[Message]:
    """Topic, type, time and content of a drive through `TIPS`: the base's frame is turned and away."""
    out: list[Message] = []
    x, y, z, w = BASE_TURN.as_quat()
    rng = np.random.default_rng(1)
    for k in range(round((len(TIPS) * (REST_S + MOVE_S) - MOVE_S) * RATE)):
        pose, within = divmod(k / RATE, REST_S + MOVE_S)
        i, share = int(pose), max(0.0, (within - REST_S) / MOVE_S)
        after = min(i + 1, len(TIPS) - 1)
        tip = (1 - share) * TIPS[i] + share * TIPS[after] + rng.normal(scale=1e-5, size=3)
        place = BASE_PLACE + BASE_TURN.apply(tip)
        t = BEGIN + k / RATE
        turn = dict(zip("xyzw", (0.0, 0.0, 0.0, 1.0), strict=True))
        base = {"position": dict(zip("xyz", BASE_PLACE, strict=True)), "orientation": {"x": x, "y": y, "z": z, "w": w}}
        tool = {"position": dict(zip("xyz", place, strict=True)), "orientation": turn}
        out.append(("/tool", "PoseStamped", t, {"pose": tool}))
        out.append(("/base", "PoseStamped", t, {"pose": base}))
        q = (1 - share) * ANGLES[i] + share * ANGLES[after]
        state = {"name": NAMES[::-1], "position": q[::-1].tolist(), "velocity": [], "effort": []}
        out.append(("/joint_states", "JointState", t, state))
    return out


def stamp(t: float, name: str) -> dict[str, int]:
    return {"sec": int(t), name: round((t - int(t)) * 1e9)}


def write_cdr(path: Path, only: tuple[str, ...]) -> None:
    from mcap_ros2.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        schemas = {
            "PoseStamped": writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE + HEADER),
            "JointState": writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE + HEADER),
        }
        for topic, kind, t, content in messages():
            if topic in only:
                whole = {"header": {"stamp": stamp(t, "nanosec"), "frame_id": ""}, **content}
                writer.write_message(topic, schemas[kind], whole, log_time=round(t * 1e9))
        writer.finish()


def write_json(path: Path, only: tuple[str, ...]) -> None:
    """Foxglove's own types: transforms in place of poses."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        named = {"PoseStamped": "foxglove.FrameTransform", "JointState": "sensor_msgs/JointState"}
        channels: Mapping[str, int] = {
            topic: writer.register_channel(topic, "json", writer.register_schema(named[kind], "jsonschema", b"{}"))
            for topic, kind in {topic: kind for topic, kind, _, _ in messages()}.items()
        }
        for topic, kind, t, content in messages():
            if topic not in only:
                continue
            whole = {"header": {"stamp": stamp(t, "nsec"), "frame_id": ""}, **content}
            if kind == "PoseStamped":
                pose = content["pose"]
                moved = {"translation": pose["position"], "rotation": pose["orientation"]}
                frames = {"parent_frame_id": "room", "child_frame_id": topic}
                whole = {"timestamp": stamp(t, "nsec"), **frames, **moved}
            writer.add_message(channels[topic], round(t * 1e9), json.dumps(whole).encode(), round(t * 1e9))
        writer.finish()


ALL = ("/tool", "/base", "/joint_states")


@pytest.mark.long
@pytest.mark.parametrize("write", [write_cdr, write_json])
def test_rests_give_tips_turns_and_angles(tmp_path: Path, write: Callable[[Path, tuple[str, ...]], None]) -> None:
    """The tool stands as the room does, and the base turned in it."""
    take, data = tmp_path / "take.mcap", tmp_path / "data.csv"
    write(take, ALL)
    words = ["--arm", "so101", "--tool", "/tool", "--base", "/base", "--orientation", "-o", data]
    code, said, complaint = run_command("import", take, take, *words)
    assert (code, complaint) == (0, "")
    assert "3 of 3 poses are in" in said
    table = np.genfromtxt(data, delimiter=",", names=True)
    q = np.radians(np.stack([table[f"q{i}_deg"] for i in range(1, 6)], axis=1))
    tips = 1e-3 * np.stack([table[f"{axis}_mm"] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(q, ANGLES, atol=1e-7)
    np.testing.assert_allclose(tips, TIPS, atol=2e-5)
    x, y, z, w = BASE_TURN.inv().as_quat(canonical=True)
    for column, expected in zip(("qw", "qx", "qy", "qz"), (w, x, y, z), strict=True):
        assert table[column] == pytest.approx(np.full(len(TIPS), expected), abs=2e-6)
    assert (table["srot_deg"] > 0.0).all()


def test_poses_may_be_a_table_as_before(tmp_path: Path) -> None:
    take, poses = tmp_path / "take.mcap", tmp_path / "poses.csv"
    write_cdr(take, ("/tool", "/base"))
    rows = [",".join(map(str, (k, *np.degrees(q)))) for k, q in enumerate(ANGLES, start=1)]
    poses.write_text("pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n" + "\n".join(rows) + "\n")
    words = ["import", take, poses, "--arm", "so101", "--tool", "/tool", "--base", "/base", "-o", tmp_path / "d.csv"]
    assert "3 of 3 poses are in" in run_command(*words)[1]


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        (("/joint_states",), "has no topic of poses: /joint_states (JointState); should be PoseStamped"),
        (("/tool",), "has no topic of joint states: /tool (PoseStamped); should be one sensor_msgs/JointState"),
        ((), "has no topic of poses at all"),
    ],
)
def test_a_missing_topic_is_one_line(tmp_path: Path, topics: tuple[str, ...], words: str) -> None:
    take = tmp_path / "take.mcap"
    write_cdr(take, topics)
    said = stderr_of("import", take, take, "--arm", "so101", "-o", tmp_path / "d.csv")
    assert words in said
    assert said.count("\n") == 1


def test_other_joints_and_other_bytes_are_one_line(tmp_path: Path) -> None:
    take, bad = tmp_path / "take.mcap", tmp_path / "bad.mcap"
    write_cdr(take, ALL)
    words = ["--tool", "/tool", "--base", "/base", "-o", tmp_path / "d.csv"]
    assert "no joint " in stderr_of("import", take, take, "--arm", "ur5", *words)
    bad.write_bytes(b"no recording")
    said = stderr_of("import", bad, bad, "--arm", "so101", *words)
    assert "is no readable MCAP file" in said
    assert said.count("\n") == 1
    bad.write_bytes(take.read_bytes()[:5000])
    assert "is no readable MCAP file" in stderr_of("import", bad, bad, "--arm", "so101", *words)
