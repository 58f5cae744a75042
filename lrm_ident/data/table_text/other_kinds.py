"""Files that are no tables, by what they begin with: bags of ROS, arrays of MATLAB and numpy, datasets, hand-eye pairs.

Whoever names one where a table is read is told in one line what the file is, and what is read in its place.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from lrm_math.errors import FileError

IMPORT = "lrm-ident import TAKE.mcap JOINTS.csv -o DATA.csv"


@dataclass(frozen=True)
class OtherKind:
    """A kind of file: how its bytes begin, or a pattern in them, what it is, and what is read in its place."""

    name: str
    begins: bytes
    what: str
    right: str
    has: re.Pattern[bytes] = re.compile(b"")


KINDS = (
    OtherKind(
        "ROS 1 bag",
        b"#ROSBAG",
        "is a bag of ROS 1",
        f"convert it (rosbags-convert --src BAG --dst OUT --dst-storage mcap), then: {IMPORT}",
    ),
    OtherKind(
        "ROS 2 bag",
        b"SQLite format 3\x00",
        "is a bag of ROS 2 in SQLite",
        f"convert it (rosbags-convert --src BAG --dst OUT --dst-storage mcap), then: {IMPORT}",
    ),
    OtherKind("MCAP", b"\x89MCAP0\r\n", "is an MCAP recording", f"{IMPORT} makes measurements of it"),
    OtherKind(
        "MATLAB",
        b"MATLAB ",
        "is a MATLAB file",
        "save a table with named columns as CSV: writetable(array2table(A, 'VariableNames', names), 'data.csv')",
    ),
    OtherKind(
        "numpy",
        b"\x93NUMPY",
        "is a numpy array without names of its columns",
        "numpy.savetxt('data.csv', A, delimiter=',', comments='', header='q1_deg,…,x_mm,y_mm,z_mm') writes a table",
    ),
    OtherKind(
        "numpy archive",
        b"PK\x03\x04",
        "is a numpy archive (.npz)",
        "numpy.savetxt('data.csv', A, delimiter=',', comments='', header='q1_deg,…,x_mm,y_mm,z_mm') writes a table",
        re.compile(rb"\.npy"),
    ),
    OtherKind(
        "OpenDocument",
        b"PK\x03\x04",
        "is an OpenDocument spreadsheet (.ods)",
        "save it as .xlsx or as CSV",
        re.compile(rb"\A.{26,60}mimetypeapplication/vnd\.oasis\.opendocument", re.DOTALL),
    ),
    OtherKind(
        "binary Excel",
        b"PK\x03\x04",
        "is a binary Excel file (.xlsb)",
        "save it as .xlsx or as CSV",
        re.compile(rb"xl/workbook\.bin"),
    ),
    OtherKind(
        "parquet", b"PAR1", "is a parquet file", "of a LeRobot dataset: lrm-ident import lerobot FOLDER -o poses.csv"
    ),
    OtherKind(
        "hand-eye pairs",
        b"",
        "has pairs of poses for a hand-eye calibration, and no joint angles",
        "a CSV with the joint angles and the position of each pose: q1_deg, q2_deg, …, x_mm, y_mm, z_mm",
        re.compile(
            rb"(?is)\A\s*(?:[\[{]|[\w-]+:).{0,400}(eye_(on|in|to)_hand|eye_on_base|hand_?eye|gripper2base|robot_pose)"
        ),
    ),
    OtherKind(
        "older LeRobot calibration",
        b"{",
        "is a calibration of an older LeRobot, which has no poses",
        "calibrate again with LeRobot 0.3 or newer; poses are those of a dataset: lrm-ident import lerobot FOLDER",
        re.compile(rb'"motor_names"'),
    ),
    OtherKind(
        "LeRobot calibration",
        b"{",
        "is a calibration of LeRobot, which has no poses",
        "lrm-ident arm export MODEL --calibration FILE -o NEW.json writes zeros into it",
        re.compile(rb'"homing_offset"'),
    ),
    OtherKind("JSON", b"{", "is JSON, no table", "write it as CSV: a header, and one row a pose"),
    OtherKind("JSON list", b"[{", "is JSON, no table", "write it as CSV: a header, and one row a pose"),
)


def check_is_table(path: Path, content: bytes) -> None:
    """Raises `FileError`: a file of another kind, which is named."""
    begin = content.removeprefix(b"\xef\xbb\xbf").lstrip() if content[:1] in b"\xef \t\r\n{[" else content
    for kind in KINDS:
        if begin.startswith(kind.begins) and kind.has.search(content):
            raise FileError(path, "", kind.what, kind.right)


def check_is_file(path: Path) -> None:
    """Raises `FileError`: a folder, and what is read of it, if that is known."""
    if not path.is_dir():
        return
    if (path / "meta" / "info.json").is_file():
        right = f"lrm-ident import lerobot {path} -o poses.csv, or lrm-ident checkup {path}"
        raise FileError(path, "", "is a folder with a LeRobot dataset", right)
    if (path / "metadata.yaml").is_file():
        raise FileError(path, "", "is the folder of a ROS 2 bag", f"name the .mcap file in it: {IMPORT}")
    raise FileError(path, "", "is a folder", "name the file in it")
