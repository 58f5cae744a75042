"""Sockets: the board that is printed, touches by hand and touches that are planned."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.so101.feetech_servo import STEP
from lrm_ident.data.measurement_file.conventions import metadata_of
from lrm_ident.data.table_text.csv_file import read_table
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.servos import BusServos, limp_servos
from lrm_ident.measuring.sockets.board import SocketBoard
from lrm_ident.measuring.sockets.by_hand import TouchLog, points_to_touch, record_touches
from lrm_ident.measuring.sockets.solid import stl, triangles
from lrm_ident.measuring.sockets.touch_plan import TouchPlan, plan_touches, postures
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.model.model import model_of
from tests.ident.measuring.feetech.test_feetech_servos import BusLine, line_of
from tests.support.commands import run_command

BOARDS = st.builds(
    SocketBoard,
    st.floats(90.0, 200.0),
    st.floats(70.0, 150.0),
    st.just(0.0) | st.floats(5.0, 60.0),
    st.floats(5.0, 11.0),
)


def written(content: bytes) -> Array:
    """(T, 3, 3), corners of the triangles of a binary STL file."""
    (count,) = struct.unpack("<I", content[80:84])
    assert len(content) == 84 + 50 * count
    rows = [struct.unpack("<12fH", content[84 + 50 * k : 134 + 50 * k]) for k in range(count)]
    return np.array([row[3:12] for row in rows]).reshape(-1, 3, 3)


@pytest.mark.long
@given(BOARDS)
def test_the_surface_is_closed_and_turned_outwards(board: SocketBoard) -> None:
    """Every edge belongs to two triangles that run along it in opposite directions; the volume is positive."""
    corners = written(stl(board))
    edges: Counter[tuple[tuple[float, ...], tuple[float, ...]]] = Counter()
    for triangle in corners.round(4).tolist():
        points = [tuple(point) for point in triangle]
        for a, b in zip(points, [*points[1:], points[0]], strict=True):
            assert a != b
            edges[a, b] += 1
    assert all(count == 1 and edges[b, a] == 1 for (a, b), count in edges.items())
    volume = float(np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()) / 6.0
    plate = 7 / 6 * board.length_mm * 5 / 4 * board.width_mm * board.thickness_mm
    assert 0.7 * plate < volume < 1.5 * plate


@pytest.mark.long
@given(BOARDS)
def test_cones_are_where_they_are_stated(board: SocketBoard) -> None:
    """Below the centre of each opening lies the apex, half an opening deep; the walls lean by 45 deg."""
    corners, radius = triangles(board), board.opening_mm / 2.0
    for place in board.points.values():
        apex = np.array(place) - [0.0, 0.0, radius]
        walls = corners[(np.abs(corners - apex).max(axis=2) < 1e-9).any(axis=1)]
        assert len(walls) == 48
        rim = walls[np.abs(walls - apex).max(axis=2) > 1e-9].reshape(-1, 3)
        assert np.allclose(np.linalg.norm(rim[:, :2] - apex[:2], axis=1), radius)
        assert np.allclose(rim[:, 2], place[2])


def test_board_is_written_with_where_its_sockets_are(tmp_path: Path) -> None:
    for name in ("board.stl", "board.pdf"):
        code, out, _ = run_command("sockets", "board", "-o", tmp_path / name)
        assert code == 0
        metadata = metadata_of(tmp_path / "board.toml")
        assert metadata.points["C"] == [160.0, 130.0, 0.0]
        assert ("E" in metadata.points) == name.endswith("stl")
        assert "A-C 206.16" in out


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["-o", "board.obj"], "should end in .stl"),
        (["-o", "board.stl", "--length-mm", "5"], "should be 30 to 400 mm"),
        (["-o", "board.stl", "--opening-mm", "40"], "sockets of 40 mm"),
        (["-o", "board.stl", "--raised-mm", "1"], "E raised by 1 mm"),
        (["-o", "board.pdf", "--length-mm", "300"], "do not fit on a4"),
        (["-o", "board.pdf", "--paper", "a9"], "no paper 'a9'"),
    ],
)
def test_bad_sizes_are_one_line(options: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = run_command("sockets", "board", *options)
    assert code == 2
    assert says in " ".join(err.split())
    assert not list(tmp_path.iterdir())


def test_a_board_cannot_be_thinner_than_its_sockets() -> None:
    with pytest.raises(LrmError, match="a plate of 5 mm"):
        SocketBoard(thickness_mm=5.0)


def limp(line: BusLine) -> BusServos:
    return limp_servos("feetech:/dev/x", ServoHost(line, FEETECH), load_arm("so101"), (1, 2, 3, 4, 5))


def recorded(line: BusLine, path: Path, answers: list[str], said: list[str]) -> int:
    """Touches by a person who gives these answers, the elbow at another angle each time."""
    steps: Iterator[str] = iter(answers)

    def ask(_: str) -> str:
        line.bus.servos[2].angle += 100 * STEP
        try:
            return next(steps)
        except StopIteration:
            raise EOFError from None

    return record_touches(limp(line), TouchLog(path, 5), ["A", "B"], ask, said.append, line.sleep)


def test_touches_are_kept_with_socket_and_placement(tmp_path: Path) -> None:
    path, said = tmp_path / "touches.csv", list[str]()
    assert recorded(line_of(1, 2, 3, 4, 5), path, ["", "", "board left", "B", "", "X", "end"], said) == 3
    rows = [line.split(",") for line in path.read_text().splitlines()]
    assert [row[-2:] for row in rows[1:]] == [["A", "1"], ["B", "1"], ["B", "left"]]
    assert abs(float(rows[1][3]) - 8.7891) < 1e-3
    assert any("'X' is none of A, B" in words for words in said)
    assert recorded(line_of(1, 2, 3, 4, 5), path, [""], said) == 1
    assert path.read_text().splitlines()[-1].startswith("4,")
    assert path.read_text().splitlines()[-1].endswith(",left")


def test_a_joint_that_moves_is_not_kept(tmp_path: Path) -> None:
    line, said = line_of(1, 2, 3, 4, 5), list[str]()
    servos = limp(line)

    def sleep(_: float) -> None:
        line.bus.servos[0].angle += 30 * STEP

    answers = iter(["", "end"])
    count = record_touches(servos, TouchLog(tmp_path / "t.csv", 5), ["A"], lambda _: next(answers), said.append, sleep)
    assert count == 0
    assert "joint 1 moved by" in said[-1]


def test_servos_with_torque_are_refused() -> None:
    line = line_of(1, 2, 3, 4, 5)
    table.TORQUE_ENABLE.write(line.bus.servos[3].memory, 1)
    with pytest.raises(LrmError, match="torque is on at wrist_flex"):
        limp(line)


def test_another_file_and_odd_names_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(FileError, match="not that of touches"):
        TouchLog(path, 5)
    for names in ("", "A,A", "A,end"):
        with pytest.raises(LrmError, match="names of sockets by commas"):
            points_to_touch(names, [])


ARM, POINTS = load_arm("so101"), SocketBoard().points


@cache
def planned(count: int = 20) -> TouchPlan:
    return plan_touches(ARM, POINTS, count, 3, 0.2e-3)


@pytest.mark.long
def test_the_tip_of_the_arm_as_drawn_is_in_each_socket_from_its_open_side() -> None:
    plan, model = planned(), model_of(ARM, ())
    T = frames(model.chain, model.chain.values([*np.ascontiguousarray(plan.q.T)]), len(plan.q))
    for number, (name, stand) in enumerate(zip(plan.points, plan.placement, strict=True)):
        board = plan.placements[stand - 1].motion(POINTS)
        goal = (board @ [*np.array(POINTS[name]) * 1e-3, 1.0])[:3]
        np.testing.assert_allclose(T[number, -1, :3, 3], goal, atol=2e-4)
        assert np.degrees(np.arccos(-T[number, -1, :3, 2] @ board[:3, 2])) < 55.0
        assert T[number, -4:-1, 2, 3].min() > 0.03
    low, high = np.array([(joint.lower, joint.upper) for joint in ARM.joints]).T
    assert np.all((plan.q >= low) & (plan.q <= high))


@pytest.mark.long
def test_planned_touches_tell_more_than_random_ones_and_more_touches_more() -> None:
    assert planned().tracker_error < planned().tip_error < planned().random_tip_error
    errors = planned().error_of
    assert [*errors] == [20, 24, 36, 60]
    assert [*errors.values()] == sorted(errors.values(), reverse=True)
    assert errors[20] == pytest.approx(planned().tip_error)
    assert errors[60] < 0.8 * errors[20]
    assert sorted(planned().placement) == list(planned().placement)
    assert {*planned().placement} == {1, 2, 3}


@pytest.mark.long
def test_a_socket_out_of_reach_has_no_posture() -> None:
    goals = np.array([[2.0, 0.0, 0.1], [0.2, 0.0, 0.02]])
    found = postures(ARM, goals, np.array([0.0, 0.0, 1.0]), np.random.default_rng(0))
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1]).all()


@pytest.mark.long
def test_too_few_touches_and_a_board_out_of_reach_are_refused() -> None:
    with pytest.raises(LrmError, match="15 or more"):
        plan_touches(ARM, POINTS, 12, 3, 0.2e-3)
    with pytest.raises(LrmError, match="smaller board"):
        plan_touches(ARM, {name: np.multiply(4.0, place) for name, place in POINTS.items()}, 20, 3, 0.2e-3)


@pytest.mark.long
def test_command_writes_touches_in_the_form_that_fit_reads(tmp_path: Path) -> None:
    assert run_command("sockets", "board", "-o", tmp_path / "board.stl", "--length-mm", 120)[0] == 0
    code, out, _ = run_command("sockets", "plan", "--board", tmp_path / "board.toml", "-o", tmp_path / "plan.csv")
    assert code == 0
    assert "placement 3" in out
    assert "Expected error of the tip" in out
    table = read_table(tmp_path / "plan.csv")
    assert table.header == ("pose", *(f"q{k}_deg" for k in range(1, 6)), "point", "placement")
    assert len(table.rows) == 24
    (tmp_path / "other.toml").write_text('schema = "lrm/measurements/1"\n')
    code, _, said = run_command("sockets", "plan", "--board", tmp_path / "other.toml", "-o", tmp_path / "no.csv")
    assert code == 2
    assert "states no [points]" in said
    assert not (tmp_path / "no.csv").exists()
