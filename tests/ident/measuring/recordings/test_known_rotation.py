"""A tool that is turned by Rx(90°) Rz(90°), worked out by hand, stands so in the measurement file, whoever recorded it.

Its x axis points along z of the room, its y axis along -x, its z axis along -y. It is a turn by 120° about (1, -1, 1),
so a left-handed reading, another order of the angles or of the quaternion, rows for columns, or rad for deg would show.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.number_table import numbers_of, read_csv
from tests.ident.measuring.recordings.test_recordings import poses, walk
from tests.support.commands import run_command

W, X, Y, Z = 0.5, 0.5, -0.5, 0.5
BY_COLUMNS = "0 0 1 -1 0 0 0 -1 0"
EULER_DEG = (90.0, 0.0, 90.0)
HELICAL_DEG = (69.2820323, -69.2820323, 69.2820323)


def motive(path: Path) -> list[str]:
    """OptiTrack: quaternions x, y, z, w."""
    rows = ["Format Version,1.25,Rotation Type,Quaternion,Length Units,Meters", "", ",Type" + ",Rigid Body" * 7]
    rows += [",Name" + ",tool" * 7, ",ID" + ",1" * 7, ",," + ",".join(["Rotation"] * 4 + ["Position"] * 3)]
    rows.append("Frame,Time (Seconds),X,Y,Z,W,X,Y,Z")
    rows += [f"{k},{t:.3f},{X},{Y},{Z},{W},{x:.6f},{y:.6f},{z:.6f}" for k, t, x, y, z in frames()]
    path.write_text("\n".join(rows) + "\n")
    return ["--tool", "tool"]


def vicon(path: Path, axes: str, numbers: tuple[float, ...], unit: str) -> None:
    """Vicon Tracker: rotations before positions."""
    count = len(numbers)
    rows = ["Objects", "100", ",,tool", f"Frame,Sub Frame,{axes},TX,TY,TZ", f",,{','.join([unit] * count)},mm,mm,mm"]
    turn = ",".join(map(str, numbers))
    rows += [f"{k + 1},0,{turn},{1e3 * x:.3f},{1e3 * y:.3f},{1e3 * z:.3f}" for k, _, x, y, z in frames()]
    path.write_text("\n".join(rows) + "\n")


def vicon_euler(path: Path) -> list[str]:
    vicon(path, "RX,RY,RZ", EULER_DEG, "deg")
    return ["--tool", "tool", "--rotation", "euler-xyz"]


def vicon_helical(path: Path) -> list[str]:
    vicon(path, "RX,RY,RZ", tuple(np.radians(HELICAL_DEG)), "rad")
    return ["--tool", "tool", "--rotation", "helical"]


def vicon_quaternion(path: Path) -> list[str]:
    vicon(path, "RX,RY,RZ,RW", (X, Y, Z, W), "")
    return ["--tool", "tool"]


def dtrack(path: Path) -> list[str]:
    """ART: the matrix by columns; the three angles beside the position are not used."""
    path.write_text(
        "".join(
            f"fr {k + 1}\nts {t:.3f}\n6d 1 [3 1.000][{1e3 * x:.3f} {1e3 * y:.3f} {1e3 * z:.3f} 7 8 9][{BY_COLUMNS}]\n"
            for k, t, x, y, z in frames()
        )
    )
    return ["--tool", "3"]


def frames() -> list[tuple[int, float, float, float, float]]:
    """Number, time (s), and tip (m) with noise."""
    t, tips = walk()
    seen = tips + np.random.default_rng(0).normal(scale=1e-4, size=tips.shape)
    return [(k, float(t[k]), *map(float, seen[k])) for k in range(len(t))]  # type: ignore[misc]


@pytest.mark.parametrize("write", [motive, vicon_euler, vicon_helical, vicon_quaternion, dtrack])
def test_a_known_rotation_reaches_the_file(write: Callable[[Path], list[str]], tmp_path: Path) -> None:
    recording, written = tmp_path / "take.csv", tmp_path / "data.csv"
    options = [*write(recording), "--arm", "lrm-rover", "--orientation", "-o", str(written)]
    run_command("import", str(recording), str(poses(tmp_path)), *options)
    table = read_csv(written, ["qw", "qx", "qy", "qz"])
    for column, expected in zip(("qw", "qx", "qy", "qz"), (W, X, Y, Z), strict=True):
        assert numbers_of(table, column) == pytest.approx(np.full(4, expected), abs=1e-6)
