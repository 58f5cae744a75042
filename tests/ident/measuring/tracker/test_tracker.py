"""Trackers: DTrack's datagrams, what spoils a rest, and files and ports full of garbage."""

from __future__ import annotations

import math
import socket
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from examples.demo.simulated_tracker import dtrack_text
from lrm_ident.measuring.tracker.dtrack import UdpTracker, parse_dtrack
from lrm_ident.measuring.tracker.dwell import RestMean, UnstableDwell, rest_mean
from lrm_ident.measuring.tracker.frames import TargetNumbers, TargetPose, TrackerFrame, tip_position
from lrm_ident.measuring.tracker.growing_csv import GrowingCsv
from lrm_ident.measuring.tracker.source import open_tracker
from lrm_math.errors import LrmError
from tests.support.commands import stderr_of
from tests.support.sweep import examples

coordinate = st.floats(-50.0, 50.0)
vector = st.tuples(coordinate, coordinate, coordinate).map(np.array)
turn = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(lambda v: Rotation.from_rotvec(v).as_matrix())
target = st.builds(TargetPose, vector, turn)
frame = st.builds(
    TrackerFrame,
    st.integers(0, 10**9),
    st.floats(0.0, 86_400.0),
    st.dictionaries(st.integers(0, 20), target, max_size=4),
)
NUMBERS = TargetNumbers(tool=1, base=0)


@given(frame)
def test_a_frame_survives_its_text(sent: TrackerFrame) -> None:
    got = parse_dtrack(dtrack_text(sent))
    assert (got.number, got.targets.keys()) == (sent.number, sent.targets.keys())
    assert math.isclose(got.t, sent.t, abs_tol=1e-6)
    for name, pose in sent.targets.items():
        np.testing.assert_allclose(got.targets[name].position, pose.position, atol=1e-6)
        np.testing.assert_allclose(got.targets[name].rotation, pose.rotation, atol=1e-6)


@given(st.binary(max_size=300))
def test_garbage_is_no_frame_and_no_error(data: bytes) -> None:
    got = parse_dtrack(data)
    assert got is None or data.startswith(b"fr")


@given(frame, st.data())
def test_a_damaged_frame_has_no_invented_targets(sent: TrackerFrame, data: st.DataObject) -> None:
    text = bytearray(dtrack_text(sent))
    for _ in range(data.draw(st.integers(1, 5))):
        text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
    got = parse_dtrack(bytes(text))
    for pose in got.targets.values() if got else ():
        assert np.isfinite(pose.position).all()
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=0.011)


def test_the_documented_example() -> None:
    text = (
        b"fr 21753\r\nts 39596.024831\r\n6dcal 2\r\n6d 1 [0 1.000][326.848 -187.216 109.503 -160.5 15.5 148.0]"
        b"[0.0 1.0 0.0 -1.0 0.0 0.0 0.0 0.0 1.0]\r\n3d 0\r\n"
    )
    got = parse_dtrack(text)
    np.testing.assert_allclose(got.targets[0].position, [0.326848, -0.187216, 0.109503])
    np.testing.assert_allclose(got.targets[0].rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])


@given(target, target, vector, turn)
def test_the_tip_is_that_seen_from_the_base_wherever_the_room_is(
    base: TargetPose, tool: TargetPose, shift: np.ndarray, room: np.ndarray
) -> None:
    moved = {
        number: TargetPose(shift + room @ pose.position, room @ pose.rotation)
        for number, pose in ((0, base), (1, tool))
    }
    here = tip_position(TrackerFrame(1, 0.0, {0: base, 1: tool}), NUMBERS)
    there = tip_position(TrackerFrame(1, 0.0, moved), NUMBERS)
    np.testing.assert_allclose(there, here, atol=1e-9)


def rest(count: int = 60, sd: float = 1e-4, seed: int = 0) -> list[TrackerFrame]:
    """Frames of a rest at (0.1, 0.2, 0.3) m."""
    noise = np.random.default_rng(seed).normal(scale=sd, size=(count, 3))
    base = TargetPose(np.zeros(3), np.eye(3))
    tips = [TargetPose(np.array([0.1, 0.2, 0.3]) + row, np.eye(3)) for row in noise]
    return [TrackerFrame(k, k / 60.0, {0: base, 1: tip}) for k, tip in enumerate(tips)]


def without_tool(frames: Sequence[TrackerFrame], rows: Sequence[int]) -> list[TrackerFrame]:
    """The frames, the tip hidden in some of them."""
    return [TrackerFrame(f.number, f.t, {0: f.targets[0]}) if k in rows else f for k, f in enumerate(frames)]


def shifted(frames: Sequence[TrackerFrame], rows: Sequence[int], by: float) -> list[TrackerFrame]:
    """The frames, the tip moved along x in some of them (m)."""
    out = list(frames)
    for k in rows:
        tip = frames[k].targets[1]
        moved = TargetPose(tip.position + np.array([by, 0.0, 0.0]), tip.rotation)
        out[k] = TrackerFrame(frames[k].number, frames[k].t, {0: frames[k].targets[0], 1: moved})
    return out


@pytest.mark.parametrize("seed", range(50))
def test_a_good_rest_is_averaged(seed: int) -> None:
    found = rest_mean(rest(seed=seed), NUMBERS)
    assert isinstance(found, RestMean)
    np.testing.assert_allclose(found.tip, [0.1, 0.2, 0.3], atol=6e-5)
    assert 0.7e-4 < found.sd < 1.3e-4
    assert found.frames == 60


@pytest.mark.parametrize(
    ("frames", "why"),
    [
        ([], "only 0"),
        ([rest()[0]] * 60, "only 1 different"),
        (without_tool(rest(), range(20, 40)), "target 1 unseen in 20 of 60"),
        (rest(sd=0.0), "frozen"),
        ([*rest(30), *[TrackerFrame(30 + k, 1.0, rest()[29].targets) for k in range(10)]], "frozen"),
        (shifted(rest(), [17], 5e-3), "1 outliers"),
        (shifted(rest(), range(30, 60), 1e-3), "still moving"),
    ],
)
def test_an_unfit_rest_is_noticed(frames: list[TrackerFrame], why: str) -> None:
    found = rest_mean(frames, NUMBERS)
    assert isinstance(found, UnstableDwell)
    assert why in found.why


def test_a_wink_of_the_camera_does_no_harm() -> None:
    assert isinstance(rest_mean(without_tool(rest(), [3, 30]), NUMBERS), RestMean)


def test_garbage_on_the_port_is_passed_over() -> None:
    with UdpTracker("127.0.0.1", 0) as tracker, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        place = ("127.0.0.1", tracker.port)
        sender.sendto(dtrack_text(rest()[5]), place)  # from before the rest: not to be counted
        original, waiting = tracker._drain, rest(10)

        def drain_then_send() -> None:
            original()
            for k, one in enumerate(waiting):
                sender.sendto(bytes(np.random.default_rng(k).integers(0, 256, 40, dtype=np.uint8)), place)
                sender.sendto(dtrack_text(one), place)

        tracker._drain = drain_then_send  # type: ignore[method-assign]
        found = tracker.frames(0.5)
        assert [one.number for one in found] == list(range(10))


def test_a_frame_that_came_in_time_counts_however_late_a_busy_computer_reads_it() -> None:
    good = rest(10)
    with UdpTracker("127.0.0.1", 0) as tracker, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

        def send() -> None:
            for one in good:
                sender.sendto(dtrack_text(one), ("127.0.0.1", tracker.port))

        tracker._drain = send  # type: ignore[method-assign]
        assert [one.number for one in tracker.frames(0.0)] == list(range(10))


@given(st.lists(st.one_of(st.binary(max_size=200), st.integers(0, 9)), min_size=1, max_size=30))
@examples(7, 15)
def test_whatever_comes_on_the_port_the_frames_among_it_arrive(sent: list[bytes | int]) -> None:
    """Numbers stand for good frames; everything else is garbage, damaged or empty."""
    good = rest(10)
    with UdpTracker("127.0.0.1", 0) as tracker, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

        def send() -> None:
            for one in sent:
                sender.sendto(dtrack_text(good[one]) if isinstance(one, int) else one, ("127.0.0.1", tracker.port))

        tracker._drain = send  # type: ignore[method-assign]
        found = tracker.frames(0.05)
    wanted = [one for one in sent if isinstance(one, int)]
    assert [one.number for one in found if one.number in range(10)][: len(wanted)] == wanted


def test_a_csv_is_followed_as_it_grows(tmp_path: Path) -> None:
    path = tmp_path / "tip.csv"
    path.write_text("t_s,note,x_mm,y_mm,z_mm\n0,old,1,2,3\n")
    with GrowingCsv(path, tool=1) as tracker:
        tracker.frames(0.0)
        with path.open("a") as file:
            file.write("1.5,a,100,200,300\n2,b,nonsense,0,0\n2.5,c,101,200,")
        first = tracker._new_frames()
        with path.open("a") as file:
            file.write("300\n")
        second = tracker._new_frames()
    assert [one.t for one in first + second] == [1.5, 2.5]
    np.testing.assert_allclose(second[0].targets[1].position, [0.101, 0.2, 0.3])


@pytest.mark.parametrize("text", ["dtrack", "dtrack:", "dtrack:70000", "csv:", "vicon:1", "dtrack:a b:5000"])
def test_a_wrong_source_is_one_line_that_says_what_would_be_right(text: str) -> None:
    with pytest.raises(LrmError, match=r"dtrack:PORT") as caught:
        open_tracker(text, NUMBERS)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("command", [("measure", "p.csv", "-o", "d.csv"), ("verify",)])
@pytest.mark.parametrize(
    ("tracker", "robot", "said"),
    [
        ("vicon:1", "rover", "--tracker vicon:1: should be dtrack:PORT"),
        ("csv:missing.csv", "rover", "missing.csv: tracker: cannot be read"),
        ("camera:0,missing.camera.toml", "rover", "missing.camera.toml"),
        ("zenoh:tip", "feetech:/dev/none,file.json", "has none; dtrack:PORT"),
    ],
)
def test_a_wrong_tracker_is_told_before_anything_is_connected(
    command: tuple[str, ...], tracker: str, robot: str, said: str
) -> None:
    """Before: without a daemon the error was the daemon's; with one its lease was taken first."""
    assert said in stderr_of(*command, "--tracker", tracker, "--robot", robot)


def test_a_rest_has_the_mean_orientation_of_the_tool_against_the_base() -> None:
    """Of frames with noise; none where the tracker sees positions only."""
    rng = np.random.default_rng(0)
    base, tool = Rotation.from_euler("xyz", [0.3, -0.5, 1.1]), Rotation.from_euler("xyz", [-1.0, 0.2, 2.0])
    noise = Rotation.from_rotvec(rng.normal(scale=0.01, size=(200, 3)))
    unknown = np.full((3, 3), np.nan)
    rests = []
    for seen in (True, False):
        frames = [
            TrackerFrame(
                k, 0.01 * k,
                {0: TargetPose(np.zeros(3), base.as_matrix()),
                 1: TargetPose(rng.normal(scale=1e-4, size=3), (tool * turn).as_matrix() if seen else unknown)},
            )
            for k, turn in enumerate(noise)
        ]  # fmt: skip
        rests.append(rest_mean(frames, TargetNumbers()))
    seen_rest, unseen = rests
    assert isinstance(seen_rest, RestMean)
    assert isinstance(unseen, RestMean)
    assert seen_rest.rotation is not None
    off = Rotation.from_matrix(seen_rest.rotation).inv() * (base.inv() * tool)
    assert off.magnitude() < 4 * 0.01 * np.sqrt(3 / 200)
    assert seen_rest.turn_sd == pytest.approx(0.01, rel=0.1)
    assert unseen.rotation is None
    assert unseen.turn_sd is None
