"""Every format of recordings: it is recognised, by its reader alone, and named wherever formats are listed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from scipy.spatial.transform import Rotation

from lrm_ident.data.table_text.csv_file import read_table
from lrm_ident.measuring.recordings.mcap_file import SUFFIX as MCAP
from lrm_ident.measuring.recordings.readers import READERS, RecordingFile, RecordingReader, read_take
from lrm_ident.measuring.tracker.growing_csv import COLUMNS as PLAIN
from lrm_math.errors import FileError
from tests.ident.measuring.recordings.test_dtrack_file import frame
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
