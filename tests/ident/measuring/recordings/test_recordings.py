"""Recordings of other programs: formats as published, rests, hidden rests and rotations, the author's own files."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import chain, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lrm_ident.data.measurement_file.number_table import numbers_of, read_csv
from lrm_ident.measuring.recordings.imported import still_rests
from lrm_ident.measuring.recordings.published_mat import read_mat_positions
from lrm_ident.measuring.recordings.readers import read_take
from lrm_ident.measuring.recordings.time_matching import rows_of_same_time
from lrm_math.errors import FileError
from tests.conftest import ROOT
from tests.ident.data.test_table_formats import workbook
from tests.support.commands import run_command, stderr_of, stdout_of

SHARED = ROOT.parent / "shared" / "data" / "lrm-lab-no-load" / "measurements.csv"
RATE, REST_S, MOVE_S, NOISE_M = 100.0, 3.0, 1.0, 1e-4
BASE_TURN = Rotation.from_euler("xyz", [0.3, -0.5, 1.1])
BASE_PLACE = np.array([0.8, -0.3, 1.1])
TIPS = np.array([[0.3, 0.1, 0.2], [0.25, -0.1, 0.3], [0.1, 0.3, 0.15], [0.3, 0.1, 0.2]])
HEADER_LINES = 8
"""Of an export of Motive."""
BODIES = ("--arm", "lrm-lab", "--tool", "Tool", "--base", "Base")
HEAD = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,payload_g,repeat_of\n"


def walk() -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and true tips (m) of an arm that rests at `TIPS` in turn, with straight moves between them."""
    parts = []
    for k, tip in enumerate(TIPS):
        if k:
            parts.append(np.linspace(TIPS[k - 1], tip, round(MOVE_S * RATE)))
        parts.append(np.tile(tip, (round(REST_S * RATE), 1)))
    tips = np.concatenate(parts)
    return np.arange(len(tips)) / RATE, tips


def recorded() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, and positions of tool and base in the room (m), with noise."""
    t, tips = walk()
    rng = np.random.default_rng(0)
    tool = BASE_PLACE + BASE_TURN.apply(tips) + rng.normal(scale=NOISE_M, size=tips.shape)
    return t, tool, np.tile(BASE_PLACE, (len(t), 1))


def motive(path: Path, unit: str = "Millimeters", factor: float = 1e3, turn: Sequence[float] = (0, 0, 0, 1)) -> Path:
    """An export of format version 1.25, with what a real one has beside the bodies; the tool is hidden for a while.

    `turn`: of the tool, as a quaternion x, y, z, w.
    """
    t, tool, base = recorded()
    x, y, z, w = BASE_TURN.as_quat()
    about = f"Format Version,1.25,Take Name,t,Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global"
    kinds = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]
    axes = [*"XYZWXYZ", ""]
    rows = [about, ""]
    rows.append(",Type" + ",Rigid Body" * 16 + ",Rigid Body Marker" * 3)
    rows.append(",Name" + ",Base" * 8 + ",Tool" * 8 + ",Tool:Marker 001" * 3)
    rows.append(",ID" + ",1" * 8 + ",2" * 8 + ",3" * 3)
    rows.append(",Parent" + "," * 19)
    rows.append(",," + ",".join([*kinds, *kinds, "Position", "Position", "Position"]))
    rows.append("Frame,Time (Seconds)," + ",".join([*axes, *axes, *"XYZ"]))
    for k in range(len(t)):
        own = [f"{v:.6f}" for v in (x, y, z, w, *base[k] * factor, 0.1)]
        hand = [f"{v:.6f}" for v in (*turn, *tool[k] * factor, 0.1)] if k % 97 else [""] * 8
        rows.append(",".join([str(k), f"{t[k]:.6f}", *own, *hand, "9", "9", "9"]))
    path.write_text("\n".join(rows) + "\n")
    return path


def vicon(
    path: Path, rotation: str, prefix: str = "", turned: Sequence[float] | None = None, unit: str = "rad"
) -> Path:
    """An export of Tracker: two objects, rotations as a helical vector, Euler angles or a quaternion.

    Both are turned as the base is, or as `turned` says in a unit.
    """
    t, tool, base = recorded()
    turn = {"helical": BASE_TURN.as_rotvec(), "euler-xyz": BASE_TURN.as_euler("XYZ"), "quaternion": BASE_TURN.as_quat()}
    angles, axes = turn[rotation] if turned is None else turned, ["RX", "RY", "RZ", "RW"][: len(turn[rotation])]
    wide = "," * (len(axes) + 2)
    rows = ["Objects", "100", f",,{prefix}Base:Base{wide},{prefix}Tool:Tool{wide}"]
    rows.append(",".join(["Frame", "Sub Frame", *2 * [*axes, "TX", "TY", "TZ"]]))
    rows.append(",".join(["", "", *2 * [*[unit] * len(axes), "mm", "mm", "mm"]]))
    for k in range(len(t)):
        numbers = [*angles, *base[k] * 1e3, *angles, *tool[k] * 1e3]
        rows.append(",".join([str(k + 1), "0", *(f"{v:.6f}" for v in numbers)]))
    path.write_text("\n".join(rows) + "\n")
    return path


def flat(text: str) -> str:
    """A text in one line."""
    return " ".join(text.split())


def poses(folder: Path) -> Path:
    """Poses, one for each rest; the last one repeats the first."""
    rows = [f"{k},0,10,20,30,40,{k},66.3,{1 if k == 4 else k}" for k in range(1, 5)]
    path = folder / "poses.csv"
    path.write_text(HEAD + "\n".join(rows) + "\n")
    return path


def log(folder: Path, rests: int = 4, unit: float = 1.0) -> Path:
    """A log of joint states at 50 Hz by another clock, half a second late; encoders flicker."""
    rng, at, parts = np.random.default_rng(3), np.array([0.0, 10, 20, 30, 40, 5]), []
    for k in range(1, rests + 1):
        goal = np.array([0.0, 10, 20, 30, 40, 9 * k])
        parts += [np.linspace(at, goal, 50), np.tile(goal, (150, 1))]
        at = goal
    q = np.concatenate(parts)
    q = (q + rng.normal(scale=0.02, size=q.shape)) * unit
    t = 1.7e9 + 0.5 + 0.02 * np.arange(len(q))
    rows = [",".join([f"{when:.2f}", *(f"{v:.5f}" for v in row)]) for when, row in zip(t, q, strict=True)]
    path = folder / "joints.csv"
    path.write_text("time,q1,q2,q3,q4,q5,q6\n" + "\n".join(rows) + "\n")
    return path


WRITERS: dict[str, tuple[Callable[[Path], Path], list[str]]] = {
    "motive, mm": (motive, ["--tool", "Tool", "--base", "Base"]),
    "motive, m": (lambda path: motive(path, "Meters", 1.0), ["--tool", "Tool", "--base", "Base"]),
    "vicon helical": (
        lambda path: vicon(path, "helical"),
        ["--tool", "Tool:Tool", "--base", "Base:Base", "--rotation", "helical"],
    ),
    "vicon euler": (
        lambda path: vicon(path, "euler-xyz", "Global Angle "),
        ["--tool", "Tool:Tool", "--base", "Base:Base", "--rotation", "euler-xyz"],
    ),
    "vicon quaternion": (lambda path: vicon(path, "quaternion"), ["--tool", "Tool:Tool", "--base", "Base:Base"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("times", [[], ["--every", "4", "--first", "2.9"]], ids=["found", "regular"])
@pytest.mark.parametrize("kind", WRITERS)
def test_the_tip_at_every_rest_comes_out_of_the_recording(tmp_path: Path, kind: str, times: list[str]) -> None:
    write, options = WRITERS[kind]
    source, data = write(tmp_path / "take.csv"), tmp_path / "data.csv"
    stdout_of("import", source, poses(tmp_path), "--arm", "lrm-lab", "-o", data, *options, *times)
    table = read_csv(data, ["pose", "x_mm", "y_mm", "z_mm", "sd_mm", "t_s", "payload_g", "repeat_of"])
    tips = np.stack([numbers_of(table, name) for name in ("x_mm", "y_mm", "z_mm")], axis=1) * 1e-3
    np.testing.assert_allclose(tips, TIPS, atol=5e-5)
    assert numbers_of(table, "repeat_of").tolist() == [1, 2, 3, 1]
    assert np.all(np.abs(numbers_of(table, "sd_mm") - NOISE_M * 1e3) < 0.02)
    np.testing.assert_allclose(np.diff(numbers_of(table, "t_s")), REST_S + MOVE_S, atol=0.2)
    assert 'arm = "lrm-lab"' in data.with_suffix(".toml").read_text()


def hidden(path: Path, begin: int, end: int) -> Path:
    """The export with the tool unseen in these frames."""
    lines = path.read_text().splitlines()
    for k in range(begin, end):
        cells = lines[k + HEADER_LINES].split(",")
        lines[k + HEADER_LINES] = ",".join([*cells[:10], *[""] * 8, *cells[18:]])
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_rest_in_which_the_tool_is_hidden_is_left_out_and_said(tmp_path: Path) -> None:
    source, data = hidden(motive(tmp_path / "take.csv"), 640, 700), tmp_path / "data.csv"
    said = stdout_of("import", source, poses(tmp_path), *BODIES, "-o", data, "--every", "4", "--first", "2.9")
    assert "left out: pose 2: target 1 unseen" in said
    assert numbers(data) == [1, 3, 4]


@pytest.mark.parametrize(
    ("change", "options", "says"),
    [
        (("Millimeters", "Furlongs"), [], "Length Units is Furlongs"),
        (("Frame,Time", "Bild,Zeit"), [], "no line that begins with Frame"),
        (("Format Version", "Version"), [], "should be a .mat file"),
        (("100,1.000000,", "100,soon,"), [], "'soon' is not a number"),
        (("Quaternion", "XYZ"), [], None),
        (None, ["--tool", "Hand"], "unknown body 'Hand'"),
        (None, ["--every", "4"], "go together"),
        (None, ["--every", "400", "--first", "3"], "the recording ends at"),
        (None, ["--skip", "1"], "there are 4 poses"),
        (None, ["--axes", "x,y"], "--axes x,y"),
        (None, ["--rotation", "zyx"], "zyx"),
    ],
)
def test_what_cannot_be_read_is_one_line_and_nothing_is_written(
    tmp_path: Path, change: tuple[str, str] | None, options: list[str], says: str | None
) -> None:
    source, data = motive(tmp_path / "take.csv"), tmp_path / "data.csv"
    if change:
        source.write_text(source.read_text().replace(*change))
    bodies = [] if "--tool" in options else ["--tool", "Tool", "--base", "Base"]
    words = ("import", source, poses(tmp_path), "--arm", "lrm-lab", "-o", data, *bodies, *options)
    if says is None:
        assert run_command(*words)[0] == 0
        return
    assert says in stderr_of(*words)
    assert not data.exists()
    assert not data.with_suffix(".toml").exists()


@pytest.mark.parametrize(("write", "header"), [(motive, 8), (lambda path: vicon(path, "quaternion"), 5)])
def test_an_export_without_frames_is_one_line(tmp_path: Path, write: Callable[[Path], Path], header: int) -> None:
    source = write(tmp_path / "take.csv")
    for rest in ([], ["", ",,"]):
        source.write_text("\n".join([*source.read_text().splitlines()[:header], *rest]) + "\n")
        with pytest.raises(FileError, match="no frames below"):
            read_take(source)


def test_rotations_that_may_mean_two_things_are_asked_for(tmp_path: Path) -> None:
    source, data = vicon(tmp_path / "take.csv", "helical"), tmp_path / "data.csv"
    words = ("import", source, poses(tmp_path), "--arm", "lrm-lab", "-o", data, "--tool", "Tool:Tool")
    assert "--rotation helical" in stderr_of(*words, "--base", "Base:Base")
    stdout_of(*words)


def test_markers_of_nexus_are_bodies_too(tmp_path: Path) -> None:
    path = tmp_path / "markers.csv"
    t, tool, _ = recorded()
    rows = ["Trajectories", "100", ";;Arm:tip;;", "Frame;Sub Frame;X;Y;Z", ";;mm;mm;mm"]
    rows += [f"{k + 1};0;" + ";".join(f"{v * 1e3:.4f}" for v in tool[k]) for k in range(len(t))]
    path.write_text("\n".join(row.replace(",", ";") for row in rows) + "\n")
    take = read_take(path)
    np.testing.assert_allclose(take.bodies["Arm:tip"].position, tool, atol=1e-6)
    np.testing.assert_allclose(take.t, t, atol=1e-9)


HEADS = [b"", b"Format Version,1.2\n", b"Objects\n100\n", b"Segments\n"]


@given(st.binary(max_size=400), st.sampled_from(HEADS))
def test_garbage_is_a_file_error_or_no_recording(data: bytes, head: bytes) -> None:
    with TemporaryDirectory() as folder, suppress(FileError):
        path = Path(folder) / "take.csv"
        path.write_bytes(head + data)
        assert len(read_take(path, "helical").bodies)


@given(st.binary(max_size=400), st.booleans())
def test_a_damaged_mat_file_is_a_file_error(data: bytes, headed: bool) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.mat"
        path.write_bytes((b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" if headed else b"") + data)
        with pytest.raises(FileError):
            read_mat_positions(path)


def test_rests_are_found_where_the_tip_stands_still() -> None:
    t, tips = walk()
    noisy = tips + np.random.default_rng(1).normal(scale=NOISE_M, size=tips.shape)
    noisy[50:70] = np.nan
    rests = still_rests(t, noisy, 1.0)
    assert len(rests) == len(TIPS)
    for rows, tip in zip(rests, TIPS, strict=True):
        assert len(rows) == pytest.approx(RATE, abs=2)
        np.testing.assert_array_equal(tips[rows], np.tile(tip, (len(rows), 1)))


@pytest.mark.parametrize(("rate", "noise_m"), [(20.0, 3e-4), (20.0, 1e-3), (100.0, 1e-3), (30.0, 0.0)])
def test_rests_are_found_through_the_noise_of_a_cheap_tracker(rate: float, noise_m: float) -> None:
    """Seventy rests, as a webcam or a cheap tracker sees them: two frames differ by more than any sag."""
    rng = np.random.default_rng(7)
    places = rng.uniform([0.1, -0.3, 0.1], [0.4, 0.3, 0.4], (70, 3))
    moves = (np.linspace(before, place, round(2.0 * rate)) for before, place in pairwise(places))
    stands = [np.tile(place, (round(3.0 * rate), 1)) for place in places]
    tips = np.concatenate([stands[0], *chain.from_iterable(zip(moves, stands[1:], strict=True))])
    noisy = tips + rng.normal(scale=noise_m, size=tips.shape)
    rests = still_rests(np.arange(len(tips)) / rate, noisy, 1.0)
    assert len(rests) == len(places)
    for rows, place in zip(rests, places, strict=True):
        np.testing.assert_array_equal(tips[rows], np.tile(place, (len(rows), 1)))


def test_rests_are_found_where_times_are_rounded_to_whole_seconds() -> None:
    """A log at 10 Hz with dates: most steps of time are zero."""
    t, tips = walk()
    rests = still_rests(np.floor(t[::10]), tips[::10], 1.0)
    assert all((tips[::10][rows] == tips[::10][rows[0]]).all() for rows in rests)


def published(folder: Path, q: np.ndarray, tips: np.ndarray) -> tuple[Path, Path]:
    """Files as the author's MATLAB wrote them: positions in mm with x and y turned, numbers and angles in rad."""
    positions, angles = folder / "measured_rotated.mat", folder / "goodconf_corrected.mat"
    scipy.io.savemat(positions, {"position_measured_rotated": tips * [-1.0, -1.0, 1.0]})
    numbers = np.arange(1, len(q) + 1)[:, None]
    scipy.io.savemat(angles, {"goodconf_corrected": np.hstack([numbers, np.radians(q)])})
    return positions, angles


@pytest.mark.skipif(not SHARED.exists(), reason="the real measurements are not here")
def test_the_real_393_poses_in_the_authors_format_equal_the_shared_table(tmp_path: Path) -> None:
    names = [*(f"q{i}_deg" for i in range(1, 7)), "x_mm", "y_mm", "z_mm", "t_s", "pose"]
    shared = read_csv(SHARED, names)
    values = np.stack([numbers_of(shared, name) for name in names], axis=1)
    positions, angles = published(tmp_path, values[:, :6], values[:, 6:9])
    data = tmp_path / "data.csv"
    times = ("--every", "15", "--first", "14")
    stdout_of("import", positions, angles, "--arm", "lrm-lab", "-o", data, *times)
    read = read_csv(data, names)
    again = np.stack([numbers_of(read, name) for name in names], axis=1)
    assert len(again) == 393
    np.testing.assert_allclose(again, values, rtol=0.0, atol=1e-6)


def test_author_files_that_do_not_fit_are_told(tmp_path: Path) -> None:
    q = np.array([[0.0, 10, 20, 30, 40, 50], [1, 10, 20, 30, 40, 50]])
    positions, angles = published(tmp_path, q, TIPS[:2] * 1e3)
    words = ("import", positions, angles, "--arm", "lrm-lab", "-o", tmp_path / "d.csv")
    stdout_of(*words, "--axes", "x,y,z")
    assert "-300.0000,-100.0000,200.0000" in (tmp_path / "d.csv").read_text()
    text = tmp_path / "conf_list.txt"
    text.write_text("1,0,0.1,0.2,0.3,0.4,0.5\n")
    assert "2 positions, there are 1 poses" in stderr_of("import", positions, text, "--arm", "lrm-lab", *words[5:])
    text.write_text("1,0,0.1\n")
    assert "3 numbers; should be 7" in stderr_of("import", positions, text, "--arm", "lrm-lab", *words[5:])
    scipy.io.savemat(positions, {"a": np.ones((2, 3)), "b": np.ones((2, 3))})
    assert "a 2x3, b 2x3" in stderr_of(*words)
    positions.write_bytes(b"MATLAB 5.0 MAT-file, but cut off")
    assert "cannot be read as a .mat file" in stderr_of(*words)


@pytest.mark.long
def test_a_log_of_joint_states_gives_the_poses_at_its_rests(tmp_path: Path) -> None:
    """By whatever clock; in radians if said, and if not the doubt is said."""
    source, data = motive(tmp_path / "take.csv"), tmp_path / "data.csv"
    words = ["import", source, log(tmp_path), "--arm", "lrm-lab", "--tool", "Tool", "--base", "Base", "-o", data]
    assert "a log of 800 joint states, in which the joints rest 4 times" in flat(run_command(*words)[2])
    table = read_csv(data, ["q6_deg", "x_mm"])
    np.testing.assert_allclose(numbers_of(table, "q6_deg"), [9, 18, 27, 36], atol=0.02)
    np.testing.assert_allclose(numbers_of(table, "x_mm"), TIPS[:, 0] * 1e3, atol=0.2)
    log(tmp_path, unit=float(np.radians(1.0)))
    assert "if they are radians: --angle-unit rad" in stderr_of(*words)
    assert "radians" not in run_command(*words, "--angle-unit", "rad")[2]
    np.testing.assert_allclose(numbers_of(read_csv(data, ["q6_deg"]), "q6_deg"), [9, 18, 27, 36], atol=0.02)
    log(tmp_path, rests=3)
    assert "the tip rests 4 times, there are 3 poses" in stderr_of(*words)


def test_poses_that_are_missing_are_told_by_their_times(tmp_path: Path) -> None:
    """Two clocks; in the middle it is known which rest has no pose, at an end of regular ones it is not."""
    source, data = motive(tmp_path / "take.csv"), tmp_path / "data.csv"
    words = ["import", source, tmp_path / "few.csv", "--arm", "lrm-lab", "--tool", "Tool", "--base", "Base", "-o", data]
    rows = [f"{1.7e9 + 4 * k + 2.4},0,10,20,30,40,{k}" for k in range(1, 5)]
    for kept in ([0, 1, 3], [0, 3]):
        text = "t_s,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n" + "\n".join(rows[k] for k in kept) + "\n"
        (tmp_path / "few.csv").write_text(text)
        assert f"there are {len(kept)} poses: {len(kept)} go together" in flat(run_command(*words)[2])
        table = read_csv(data, ["pose", "q6_deg", "x_mm"])
        assert numbers_of(table, "pose").tolist() == [k + 1 for k in kept]
        assert numbers_of(table, "q6_deg").tolist() == [k + 1 for k in kept]
        np.testing.assert_allclose(numbers_of(table, "x_mm"), TIPS[kept, 0] * 1e3, atol=0.2)
    (tmp_path / "few.csv").write_text("t_s,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n" + "\n".join(rows[:3]) + "\n")
    assert "there are 3 poses; give --skip" in stderr_of(*words)


@given(st.lists(st.floats(3.0, 30.0), min_size=6, max_size=30), st.data())
def test_rests_and_poses_of_irregular_times_find_each_other(gaps: list[float], data: st.DataObject) -> None:
    rests, shift = np.cumsum(gaps), data.draw(st.floats(-1e9, 1e9))
    kept = np.array(sorted(data.draw(st.sets(st.integers(0, len(gaps) - 1), min_size=1))))
    one, other = (
        rows_of_same_time(*pair, 1.0) for pair in ((rests, rests[kept] + shift), (rests[kept] + shift, rests))
    )
    assert (one is None) == (other is None)
    if one is not None and other is not None:  # not where another shift explains as many
        assert one[0].tolist() == other[1].tolist() == kept.tolist()
    if kept[0] == 0 and kept[-1] == len(rests) - 1:
        assert one is not None, "both ends are there"


def test_the_orientation_of_the_tool_is_that_against_the_base(tmp_path: Path) -> None:
    """The tool stands as the room does."""
    recording, written = motive(tmp_path / "take.csv"), tmp_path / "data.csv"
    run_command("import", recording, poses(tmp_path), *BODIES, "--orientation", "-o", written)
    table = read_csv(written, ["qw", "qx", "qy", "qz", "srot_deg"])
    x, y, z, w = BASE_TURN.inv().as_quat(canonical=True)
    for column, expected in zip(("qw", "qx", "qy", "qz"), (w, x, y, z), strict=True):
        assert numbers_of(table, column) == pytest.approx(np.full(4, expected), abs=2e-6)
    assert (numbers_of(table, "srot_deg") == 0.001).all()


def test_a_recording_without_rotations_has_no_orientation(tmp_path: Path) -> None:
    recording = vicon(tmp_path / "take.csv", "helical")
    words = ["--tool", "Tool:Tool", "--arm", "lrm-rover", "--orientation", "-o", str(tmp_path / "data.csv")]
    said = stderr_of("import", str(recording), str(poses(tmp_path)), *words)
    assert "no orientation of the tool: Euler angles and helical vectors look the same" in flat(said)


W, X, Y, Z = 0.5, 0.5, -0.5, 0.5
BY_COLUMNS = "0 0 1 -1 0 0 0 -1 0"
EULER_DEG = (90.0, 0.0, 90.0)
HELICAL_DEG = (69.2820323, -69.2820323, 69.2820323)


def dtrack(path: Path) -> None:
    """ART: the matrix by columns; the three angles beside the position are not used."""
    t, tool, _ = recorded()
    rows = (
        f"fr {k + 1}\nts {t[k]:.3f}\n6d 1 [3 1.000][{x:.3f} {y:.3f} {z:.3f} 7 8 9][{BY_COLUMNS}]\n"
        for k, (x, y, z) in enumerate(1e3 * tool)
    )
    path.write_text("".join(rows))


TURNED: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "motive": (lambda path: motive(path, turn=(X, Y, Z, W)), ["Tool"]),
    "euler": (
        lambda path: vicon(path, "euler-xyz", "", EULER_DEG, "deg"), ["Tool:Tool", "--rotation", "euler-xyz"]
    ),
    "helical": (
        lambda path: vicon(path, "helical", "", np.radians(HELICAL_DEG)), ["Tool:Tool", "--rotation", "helical"]
    ),
    "quaternion": (lambda path: vicon(path, "quaternion", "", (X, Y, Z, W)), ["Tool:Tool"]),
    "dtrack": (dtrack, ["3"]),
}  # fmt: skip


@pytest.mark.parametrize("kind", TURNED)
def test_a_known_rotation_reaches_the_file(kind: str, tmp_path: Path) -> None:
    write, tool = TURNED[kind]
    recording, written = tmp_path / "take.csv", tmp_path / "data.csv"
    write(recording)
    words = ["--arm", "lrm-rover", "--orientation", "-o", written, "--tool", *tool]
    run_command("import", recording, poses(tmp_path), *words)
    table = read_csv(written, ["qw", "qx", "qy", "qz"])
    for column, expected in zip(("qw", "qx", "qy", "qz"), (W, X, Y, Z), strict=True):
        assert numbers_of(table, column) == pytest.approx(np.full(4, expected), abs=1e-6)


def numbers(data: Path) -> list[float]:
    return [float(number) for number in numbers_of(read_csv(data, ["pose"]), "pose")]


@pytest.mark.long
@pytest.mark.parametrize(("begin", "end"), [(380, 720), (480, 700), (560, 700)], ids=["whole", "most", "the end"])
def test_a_hidden_rest_is_found_by_its_gap_and_left_out(tmp_path: Path, begin: int, end: int) -> None:
    source, data = hidden(motive(tmp_path / "take.csv"), begin, end), tmp_path / "data.csv"
    said = stdout_of("import", source, poses(tmp_path), *BODIES, "-o", data)
    assert "left out: pose 2: target 1 unseen" in said
    assert numbers(data) == [1, 3, 4]


def test_a_short_gap_on_the_way_is_no_rest(tmp_path: Path) -> None:
    source, data = hidden(motive(tmp_path / "take.csv"), 305, 390), tmp_path / "data.csv"
    stdout_of("import", source, poses(tmp_path), *BODIES, "-o", data)
    assert numbers(data) == [1, 2, 3, 4]


def test_rests_shorter_than_twice_the_dwell_name_the_dwell_that_finds_them(tmp_path: Path) -> None:
    source, data = motive(tmp_path / "take.csv"), tmp_path / "data.csv"
    words = ["import", source, poses(tmp_path), *BODIES, "-o", data]
    said = stderr_of(*words, "--dwell", "1.7")
    assert "a rest lasts 3.4 s (twice --dwell) or more" in said
    named = re.search(r"(--dwell) ([\d.]+) finds as many", said)
    stdout_of(*words, *named.groups())
    assert numbers(data) == [1, 2, 3, 4]


def cells_of(path: Path) -> list[list[str]]:
    return list(csv.reader(path.read_text().splitlines()))


def as_semicolons(path: Path) -> Path:
    """The file saved by Excel where commas are decimal."""
    rows = cells_of(path)
    wide = max(map(len, rows))
    lines = [";".join([*(cell.replace(".", ",") for cell in row), *[""] * (wide - len(row))]) for row in rows[1:]]
    path.write_text("\n".join(["sep=;", ";".join(rows[0]), *lines]) + "\n")
    return path


def as_workbook(path: Path) -> Path:
    rows: list[list[object]] = [
        [float(cell) if re.fullmatch(r"-?[\d.]+", cell) else cell for cell in row] for row in cells_of(path)
    ]
    return workbook(path.with_suffix(".xlsx"), rows)


@pytest.mark.long
@pytest.mark.parametrize("saved", [as_semicolons, as_workbook])
def test_what_excel_saved_again_is_the_same_on_either_side(tmp_path: Path, saved: Callable[[Path], Path]) -> None:
    first, again = tmp_path / "first.csv", tmp_path / "again.csv"
    stdout_of("import", motive(tmp_path / "take.csv"), poses(tmp_path), *BODIES, "-o", first)
    source, driven = saved(tmp_path / "take.csv"), saved(tmp_path / "poses.csv")
    stdout_of("import", source, driven, *BODIES, "-o", again)
    one, other = (np.genfromtxt(path, delimiter=",", skip_header=1) for path in (first, again))
    np.testing.assert_allclose(one, other, atol=1e-3)
