"""The files that the author of the thesis published: a position for each pose, and the angles beside them.

`measured_rotated.mat` has `position_measured_rotated` (N, 3) in mm, in the frame of the base target. `goodconf*.mat`
have one row a pose: its number, then its joint angles in rad; `conf_list.txt` is the same as text. The author's code
turns x and y of the positions ("to correct for base frame placed backwards").
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.io

from lrm_ident.data.table_text.csv_file import read_text
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError

AXES = "-x,-y,z"
"""Axes of the published positions that are the arm's."""


def read_mat_positions(path: Path) -> Array:
    """(N, 3), positions (m) of a `.mat` file: of its only array with three columns. Raises `FileError`."""
    return _only(path, 3) * MM


def read_mat_poses(path: Path, joints: int) -> tuple[Array, Array]:
    """Numbers (N,) and joint angles (N, n), rad, of a `.mat` file or of text without a header. Raises `FileError`."""
    rows = _text_rows(path, joints + 1) if path.suffix == ".txt" else _only(path, joints + 1)
    if not np.array_equal(rows[:, 0], np.round(rows[:, 0])) or len(set(rows[:, 0].tolist())) < len(rows):
        raise FileError(path, "first column", "not the numbers of the poses, each once")
    return rows[:, 0], rows[:, 1:]


def _only(path: Path, columns: int) -> Array:
    """The only finite array (N, columns) of a `.mat` file."""
    try:
        arrays = scipy.io.loadmat(path)
    except FileNotFoundError:
        raise FileError(path, "", "no such file") from None
    except NotImplementedError:
        raise FileError(path, "", "is of MATLAB's version 7.3", "save it with -v7") from None
    except Exception as error:  # scipy's reader raises whatever it stumbles over in a file that is damaged
        raise FileError(path, "", f"cannot be read as a .mat file ({error})") from None
    named = {name: value for name, value in arrays.items() if not name.startswith("__")}
    fitting = [
        name
        for name, value in named.items()
        if getattr(value, "ndim", 0) == 2 and value.shape[1] == columns and np.issubdtype(value.dtype, np.number)
    ]
    if len(fitting) != 1:
        contents = (
            ", ".join(f"{name} {'x'.join(map(str, np.shape(value)))}" for name, value in named.items()) or "nothing"
        )
        raise FileError(path, "", f"has {contents}", f"should have one array with {columns} columns")
    values = np.asarray(named[fitting[0]], dtype=np.float64)
    if not len(values) or not np.isfinite(values).all():
        raise FileError(path, fitting[0], "is empty, or has numbers that are not finite")
    return values


def _text_rows(path: Path, columns: int) -> Array:
    rows = []
    for number, line in enumerate(read_text(path).text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            rows.append([float(cell) for cell in line.split(",")])
        except ValueError:
            raise FileError(path, f"line {number}", "not numbers by commas") from None
        if len(rows[-1]) != columns:
            raise FileError(path, f"line {number}", f"{len(rows[-1])} numbers", f"should be {columns}")
    if not rows:
        raise FileError(path, "", "no poses")
    return np.array(rows)
