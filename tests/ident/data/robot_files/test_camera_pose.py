"""Where a camera stands, in files of others: each read by its own rules, it is the camera that went in."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import yaml
from scipy.spatial.transform import Rotation

from lrm_ident.measuring.camera.session import CameraSession
from lrm_math.model.reading import FrameTable
from tests.support.commands import stderr_of, stdout_of
from validation.camera.rendered_photos import WEBCAM as LENS

CAMERA = FrameTable(x_mm=310.5, y_mm=-20.25, z_mm=402.0, alpha_deg=170.0, beta_deg=12.0, gamma_deg=-80.0)
MOUNT = FrameTable(x_mm=0.0, y_mm=0.0, z_mm=0.0, alpha_deg=0.0, beta_deg=0.0, gamma_deg=0.0)
EXPECTED = np.eye(4)
EXPECTED[:3, :3] = Rotation.from_euler("XYZ", (170.0, 12.0, -80.0), degrees=True).as_matrix()
EXPECTED[:3, 3] = 0.3105, -0.02025, 0.402


@pytest.fixture
def session(tmp_path: Path) -> Path:
    made = CameraSession(schema="lrm/camera-session/1", arm="so101", lens=LENS, camera=CAMERA, mount=MOUNT)
    (path := tmp_path / "data.camera.toml").write_text(tomli_w.dumps(made.model_dump(by_alias=True)))
    return path


def motion(at: object, turn: object) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_quat(np.array(turn, dtype=float)).as_matrix(), np.array(at, dtype=float)
    return out


def test_each_file_has_the_camera_that_went_in(session: Path, tmp_path: Path) -> None:
    for end in (".launch.py", ".yaml", ".json"):
        said = stdout_of("camera", "export", session, "--base", "base", "--frame", "eye", "-o", tmp_path / f"c{end}")
        assert "eye at base: x 310.5, y -20.2, z 402.0 mm" in " ".join(said.split())
    made = json.loads((tmp_path / "c.json").read_text())
    np.testing.assert_allclose(made["matrix_m"], EXPECTED, atol=1e-8)
    np.testing.assert_allclose(motion(made["position_m"], made["quaternion_xyzw"]), EXPECTED, atol=1e-8)
    tf = yaml.safe_load((tmp_path / "c.yaml").read_text())
    parts = [tf["transform"]["translation"][axis] for axis in "xyz"], [tf["transform"]["rotation"][k] for k in "xyzw"]
    np.testing.assert_allclose(motion(*parts), EXPECTED, atol=1e-8)
    assert (tf["header"]["frame_id"], tf["child_frame_id"]) == ("base", "eye")
    tree = ast.parse((tmp_path / "c.launch.py").read_text())
    (words,) = (
        ast.literal_eval(k.value) for k in ast.walk(tree) if isinstance(k, ast.keyword) and k.arg == "arguments"
    )
    given = dict(zip(words[::2], words[1::2], strict=True))
    parts = [given[f"--{axis}"] for axis in "xyz"], [given[f"--q{k}"] for k in "xyzw"]
    np.testing.assert_allclose(motion(*parts), EXPECTED, atol=1e-8)
    assert (given["--frame-id"], given["--child-frame-id"]) == ("base", "eye")


def test_another_ending_is_one_line(session: Path, tmp_path: Path) -> None:
    for name in ("c.txt", "c.py"):
        said = stderr_of("camera", "export", session, "-o", tmp_path / name)
        assert "name it .launch.py, .yaml or .json" in said
