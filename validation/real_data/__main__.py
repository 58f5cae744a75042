"""Held-out error on public measurements of real arms, ours beside rigid least squares, a Gaussian process and boosting.

    python -m validation.real_data [--mirror FOLDER] [--poses N]

All on the same folds, of joint space or of placements. Without a network the data sets are skipped, and the reason is
printed.
"""

from __future__ import annotations

from pathlib import Path

from validation.options import asked
from validation.real_data.grids import GridSource, nominal_and_difference
from validation.real_data.sources import NotReachable
from validation.real_data.touched_sockets import TouchSource

WAM = str(Path(__file__).with_name("wam.toml"))
SOURCES = (
    GridSource(
        repository="pauljac7700/serial_robots_datasets",
        path="UR5/3D_UR5_uncalibrated_grid_cleaned.csv",
        commit="759068d85a8b95183cd71ff96d9dfc5173bc57fc",
        licence="MIT",
        author="P. Jacobi, Tsinghua University, 2025",
        arm="ur5",
        measurements=nominal_and_difference,
    ),
    GridSource(
        repository="pauljac7700/serial_robots_datasets",
        path="WAM/3D_WAM_uncalibrated_grid_cleaned.csv",
        commit="759068d85a8b95183cd71ff96d9dfc5173bc57fc",
        licence="MIT",
        author="P. Jacobi, Tsinghua University, 2025",
        arm=WAM,
        measurements=nominal_and_difference,
    ),
    TouchSource(
        repository="platonics-delft/kinematics_calibration",
        path="data/panda_2",
        placements=(
            "back_left", "back_right", "front_center", "front_left", "front_right", "high", "mid-high", "mid_left",
            "mid_right",
        ),
        urdf="urdf/panda.urdf",
        tip="ball_link",
        commit="05a05ab4cbbe328c8f5bfcc76479c752ed07b82e",
        licence="MIT",
        author="G. Franzese, M. Spahn, M. Ramirez, TU Delft, 2024",
    ),
)  # fmt: skip


def main() -> None:
    """Prints one table for each data set that can be had."""
    options = asked(
        __doc__,
        mirror=(None, "folder with OWNER/NAME/PATH of the files, in place of the network"),
        poses=(0, "at most so many poses of each data set, or touches of each socket; 0: all"),
    )
    for source in SOURCES:
        print(f"{source.repository} {source.path}, {source.licence}, {source.author}", flush=True)
        try:
            found = source.held_out(options.mirror, options.poses or None)
        except NotReachable as why:
            print(f"  skipped: {why}; give --mirror FOLDER where there is no network")
            continue
        for name, rms in found.items():
            print(f"  {name:40} {1e3 * rms:7.3f} mm RMS held out")


if __name__ == "__main__":
    main()
