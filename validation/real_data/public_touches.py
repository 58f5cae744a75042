"""Public recordings of touched sockets (MUKCa: a ball in two sockets, 50 mm apart) as files of touches.

A clone of github.com/platonics-delft/kinematics_calibration has them as data/ARM/PLACEMENT/hole_K.csv: joint angles
(rad) without a header, one row a touch; the arm's file is made of its URDF by `lrm-ident arm import`. Nothing of it is
kept here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.write import write_with_metadata
from validation.options import asked

DISTANCE_MM = 50.0
SOURCE = "github.com/platonics-delft/kinematics_calibration"


def touches(folder: Path, placements: list[str]) -> str:
    """CSV text of the touches of one arm, hole by hole in the order of the recordings."""
    rows = []
    for placement in placements:
        for hole in (0, 1):
            q = np.atleast_2d(np.loadtxt(folder / placement / f"hole_{hole}.csv", delimiter=","))
            rows += [[*np.degrees(angles).round(5).tolist(), f"hole_{hole}", placement] for angles in q]
    joints = len(rows[0]) - 2
    header = ",".join(["pose", *(f"q{k}_deg" for k in range(1, joints + 1)), "point", "placement"])
    lines = (",".join(map(str, (number, *row))) for number, row in enumerate(rows, start=1))
    return "\n".join([header, *lines]) + "\n"


def main() -> None:
    """Writes the touches of an arm, of all its placements or of those named, as a CSV and the file beside it."""
    given = asked(
        main.__doc__,
        "folder",
        "arm",
        out=Path("touches.csv"),
        placements=("", "by commas; else all"),
        without=("", "placements left out, by commas"),
    )
    every = sorted(path.name for path in given.folder.iterdir() if path.is_dir())
    named = given.placements.split(",") if given.placements else every
    chosen = [name for name in named if name not in given.without.split(",")]
    text = touches(given.folder, chosen)
    write_with_metadata(given.out, text, str(given.arm), SOURCE, distances={"hole_0-hole_1": DISTANCE_MM})


if __name__ == "__main__":
    main()
