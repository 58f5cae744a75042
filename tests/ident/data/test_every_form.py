"""Every documented form of a measurement file (docs/files.md) goes through every command that reads measurements.

Through one of those that diagnose in turn; in `make soak` through all.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.rigid_motion import quaternions
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.sensed import tool_rotation
from tests.support.commands import stdout_of
from tests.support.sweep import in_soak

pytestmark = [pytest.mark.usefixtures("one_step_folds"), pytest.mark.long]
SD_MM = 0.1
POINT_MM = (150.0, -450.0, 50.0)
ANGLES, XYZ = ("pose", "q1_deg", "q2_deg"), ("x_mm", "y_mm", "z_mm")
STRING = ("pose", *(f"q{j}_deg" for j in range(1, 3)), "distance_mm")
POSITIONS = (*ANGLES, *XYZ)
POSITION_COVARIANCE = ("cxx_mm2", "cxy_mm2", "cxz_mm2", "cyy_mm2", "cyz_mm2", "czz_mm2")
CROSS_COVARIANCE = tuple(f"c{a}{u}_mmdeg" for a in "xyz" for u in "uvw")
TURN_COVARIANCE = ("cuu_deg2", "cuv_deg2", "cuw_deg2", "cvv_deg2", "cvw_deg2", "cww_deg2")
ORIENTATION = ("qw", "qx", "qy", "qz")
FROM = f"distance_from_mm = {list(POINT_MM)}"

FORMS: dict[str, tuple[tuple[str, ...], str, tuple[str, ...]]] = {
    "positions, poses not numbered": (POSITIONS[1:], "", ()),
    "a string from an unknown point": (STRING, "distance_sd_mm = 0.1", ()),
    "a string from a known point": (STRING, f"{FROM}\ndistance_sd_mm = 0.1", ()),
    "a string beside positions, both in part": (
        (*POSITIONS, "sd_mm", "distance_mm", "distance_sd_mm"), FROM, ("x_mm y_mm z_mm", "distance_mm"),
    ),
    "orientations": ((*POSITIONS, *ORIENTATION, "sd_mm", "srot_deg"), "", ("qw qx qy qz",)),
    "covariances": (
        (*POSITIONS, *ORIENTATION, *POSITION_COVARIANCE, *CROSS_COVARIANCE, *TURN_COVARIANCE), "", (),
    ),
    "deviations of each axis, encoders, times, sessions, loads, environment": (
        (
            *POSITIONS, "sx_mm", "sy_mm", "sz_mm", "q1_meas_deg", "q2_meas_deg", "t_s", "session", "payload_g",
            "temp_c", "supply_v", "repeat_of",
        ),
        "feedback_sd_deg = 0.05", ("q2_meas_deg",),
    ),
    "dates, gravity, one direction of approach": ((*POSITIONS, "dates", "gx", "gy", "gz", "approach"), "", ()),
    "an unknown frame, its tilt, directions of approach": (
        (*POSITIONS, "roll_deg", "pitch_deg", "approach1", "approach2"), 'noise_sd_mm = 0.1\nframe = "unknown"', (),
    ),
}  # fmt: skip
"""By name: the columns, lines of the file beside the data, and groups of cells of which every fourth is empty."""


def cells(arm: Arm, poses: int) -> dict[str, np.ndarray]:
    """(N,), cells of every column of N poses, of an arm whose second joint is 1 deg off its zero."""
    rng = np.random.default_rng(1)
    q = np.round(rng.uniform(-60.0, 60.0, (poses, arm.dof)), 3)
    model = model_of(arm, effects_at(arm, "offsets"), {"offsets.joint2.theta_rad": 0.0175})
    settled = solve_equilibrium(model, poses_of(np.radians(q)))
    tip = 1e3 * settled.tcp + rng.normal(0.0, SD_MM, (poses, 3))
    number, one = np.arange(1, poses + 1), np.ones(poses)
    columns: dict[str, np.ndarray] = {"pose": number, "repeat_of": number, "sd_mm": SD_MM * one, "srot_deg": 0.1 * one}
    columns |= {f"q{j + 1}_deg": q[:, j] for j in range(arm.dof)}
    columns |= {f"q{j + 1}_meas_deg": q[:, j] + rng.normal(0.0, 0.05, poses) for j in range(arm.dof)}
    columns |= {f"approach{j}": one for j in ("", 1, 2)} | {f"s{axis}_mm": SD_MM * one for axis in "xyz"}
    columns |= dict(zip(XYZ, tip.T, strict=True))
    columns |= dict(zip(ORIENTATION, quaternions(tool_rotation(settled)).T, strict=True))
    columns |= {name: (0.01 if name[1] == name[2] else 0.0) * one for name in POSITION_COVARIANCE + TURN_COVARIANCE}
    columns |= dict.fromkeys(CROSS_COVARIANCE, 0.0 * one)
    string = np.linalg.norm(tip - POINT_MM, axis=1)
    columns |= {"distance_mm": string, "distance_sd_mm": SD_MM * one}
    columns |= {"t_s": 10.0 * number, "session": 1 + number // 13, "payload_g": 0.0 * one, "temp_c": 20.0 + number % 5}
    columns |= {"supply_v": 12.0 * one, "gx": 0.0 * one, "gy": 0.0 * one, "gz": -one, "roll_deg": 0.0 * one}
    columns |= {"pitch_deg": 0.0 * one, "dates": np.array([f"2024-07-15T10:{n % 60:02d}:00" for n in number])}
    return columns


def written(path: Path, columns: tuple[str, ...], beside: str, in_part: tuple[str, ...]) -> Path:
    arm, poses = ("two-joint", 40) if columns == STRING else ("two-joint", 24)
    every = cells(load_arm(arm), poses)
    table = np.array([[str(cell) for cell in every[name]] for name in columns], dtype=object)
    for k, group in enumerate(in_part):
        table[np.ix_(np.array([columns.index(name) for name in group.split()]), np.arange(k, poses, 4))] = ""
    header = ",".join("t_s" if name == "dates" else name for name in columns)
    path.write_text("\n".join([header, *(",".join(row) for row in table.T)]) + "\n")
    path.with_suffix(".toml").write_text(f'schema = "lrm/measurements/1"\narm = "{arm}"\n{beside}\n')
    return path


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("form", FORMS)
def test_every_form_goes_through_every_command(form: str, tmp_path: Path) -> None:
    data, model = written(tmp_path / "data.csv", *FORMS[form]), tmp_path / "model.toml"
    assert len(lrm.load(data)) == len(data.read_text().splitlines()) - 1
    stdout_of("fit", data, "-o", model)
    stdout_of("compare", model, data)
    stdout_of("predict", model, data, "-o", tmp_path / "predicted.csv")
    diagnosing = (
        ("diagnose", model, data),
        ("auto", model, data, "-o", tmp_path / "auto.toml", "--max-effects", "0", "--no-nested"),
        ("report", model, data, "-o", tmp_path / "report.html"),
    )
    turn = list(FORMS).index(form) % len(diagnosing)  # a diagnosis is most of the time
    for command in diagnosing if in_soak() else diagnosing[turn : turn + 1]:
        stdout_of(*command)
