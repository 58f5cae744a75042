"""Every format of recordings is recognised by its reader alone; a file of DTrack is read as a live tracker would be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lrm_ident.data.table_text.csv_file import read_table
from lrm_ident.measuring.recordings.mcap_file import SUFFIX as MCAP
from lrm_ident.measuring.recordings.readers import READERS, RecordingFile, RecordingReader, read_take
from lrm_ident.measuring.tracker.growing_csv import COLUMNS as PLAIN
from lrm_math.errors import FileError
from tests.ident.measuring.recordings.test_mcap import write_cdr
from tests.ident.measuring.recordings.test_recordings import motive, vicon
from tests.support.commands import stdout_of

RECORDED: Mapping[str, Callable[[Path], object]] = {
    "an MCAP file": lambda path: write_cdr(path, ("/tool",)),
    "DTrack's ASCII output": lambda path: path.write_text(frame(1, 0.0, {1: [1.0, 2.0, 3.0]}, Rotation.identity())),
    "a CSV of OptiTrack Motive": motive,
    "a CSV of Vicon Tracker or Nexus": lambda path: vicon(path, "quaternion"),
    f"a CSV with {', '.join(PLAIN)}": lambda path: path.write_text(f"{','.join(PLAIN)}\n0,1,2,3\n1,1,2,3\n"),
}
"""How to write a file of each format."""
every_reader = pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)


@every_reader
def test_a_file_is_read_by_the_reader_of_its_format_alone(tmp_path: Path, reader: RecordingReader) -> None:
    path = tmp_path / f"take{MCAP if 'MCAP' in reader.name else '.csv'}"
    RECORDED[reader.name](path)
    others = [one for one in READERS if one is not reader and path.suffix != MCAP]
    assert [one.name for one in [reader, *others] if one.recognises(RecordingFile(path))] == [reader.name]
    assert read_take(path).bodies


@every_reader
def test_where_measurements_belong_a_recording_is_sent_to_import(tmp_path: Path, reader: RecordingReader) -> None:
    path = tmp_path / "take.csv"
    RECORDED[reader.name](path)
    if PLAIN[0] in reader.name:
        assert read_table(path).header == PLAIN
        return
    with pytest.raises(FileError, match=r"lrm-ident import|\.mcap|MCAP"):
        read_table(path)


@every_reader
def test_helps_and_errors_name_it(tmp_path: Path, reader: RecordingReader, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    path = tmp_path / "take.csv"
    path.write_text("something else\n1\n")
    with pytest.raises(FileError) as refused:
        read_take(path)
    texts = [str(refused.value), *(stdout_of(*words, "--help") for words in (["import"], ["motion", "fit"]))]
    assert [text for text in texts if reader.name not in " ".join(text.replace("│", " ").split())] == []


places = st.lists(st.floats(-2000.0, 2000.0), min_size=3, max_size=3)
frames = st.lists(st.dictionaries(st.integers(0, 3), places, max_size=4), min_size=1, max_size=8)


def frame(number: int, t: float, targets: dict[int, list[float]], turn: Rotation) -> str:
    """One datagram as the manual has it: positions in mm, the rotation matrix by columns."""
    R = " ".join(f"{x:.6f}" for x in turn.as_matrix().T.ravel())
    seen = "".join(
        f"[{name} 1.000][{x:.3f} {y:.3f} {z:.3f} 0 0 0][{R}]{' ' if k + 1 < len(targets) else ''}"
        for k, (name, (x, y, z)) in enumerate(targets.items())
    )
    return f"fr {number}\nts {t:.6f}\n6dcal 4\n6d {len(targets)} {seen}\n"


@given(frames, st.integers(0, 100), st.booleans())
def test_every_target_is_a_body_and_nan_where_it_was_not_seen(
    tmp_path_factory: pytest.TempPathFactory, taken: list[dict[int, list[float]]], seed: int, cut: bool
) -> None:
    turn = Rotation.random(random_state=seed)
    text = "".join(frame(7 + k, 40000.0 + 0.0166 * k, one, turn) for k, one in enumerate(taken))
    path = tmp_path_factory.mktemp("take") / "take.txt"
    path.write_text(text + ("fr 99\nts 40" if cut else ""))
    numbers = {number for one in taken for number in one}
    if not numbers:
        with pytest.raises(FileError, match="no target was seen"):
            read_take(path)
        return
    take = read_take(path)
    assert set(take.bodies) == {str(number) for number in numbers}
    np.testing.assert_allclose(take.t, 40000.0 + 0.0166 * np.arange(len(taken)), atol=1e-5)
    for name, body in take.bodies.items():
        for row, one in enumerate(taken):
            if int(name) not in one:
                assert np.isnan(body.position[row]).all()
                continue
            np.testing.assert_allclose(body.position[row], 1e-3 * np.array(one[int(name)]), atol=1e-6)
            np.testing.assert_allclose(body.rotation[row], turn.as_matrix(), atol=1e-5)


def test_a_frame_that_cannot_be_read_is_named_by_its_line(tmp_path: Path) -> None:
    good = frame(1, 1.0, {1: [1.0, 2.0, 3.0]}, Rotation.identity())
    path = tmp_path / "take.txt"
    path.write_text(good + "fr 2\n6d 0\n" + good)
    with pytest.raises(FileError, match=r"line 5.*ts"):
        read_take(path)
