"""The board with sockets: a closed solid with cones where they are stated, a page to drill it by, bad sizes refused."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.conventions import metadata_of
from lrm_ident.measuring.sockets.board import SocketBoard
from lrm_ident.measuring.sockets.solid import stl, triangles
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
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
        assert metadata is not None
        assert metadata.points is not None
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
