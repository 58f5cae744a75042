"""`make real-data` skips without a network, with the reason, and reads a local mirror alike."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from urllib.error import URLError
from xml.etree import ElementTree

import numpy as np
import pytest

from lrm_ident.data.rigid_motion import placement_motion
from lrm_ident.data.robot_files.urdf_export import bare_urdf
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.ident.data.test_touches import HIDDEN, STANDS, at_goals
from validation.real_data import __main__ as program
from validation.real_data import rivals, sources
from validation.real_data.__main__ import SOURCES, main
from validation.real_data.touched_sockets import HOLES, TouchSource

SOURCE = SOURCES[0]


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> None:
    monkeypatch.setattr(sys, "argv", ["real_data", *words])
    main()


def test_without_a_network_it_is_skipped_and_the_reason_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def unreachable(address: str, timeout: float) -> None:
        assert any(source.commit in address for source in SOURCES)
        assert timeout > 0.0
        raise URLError("no route to host")

    monkeypatch.setattr(sources, "urlopen", unreachable)
    run(monkeypatch)
    said = capsys.readouterr().out
    assert said.count("skipped: https://") == len(SOURCES)
    assert "no route to host; give --mirror FOLDER where there is no network" in said
    run(monkeypatch, "--mirror", str(tmp_path))
    assert "skipped: no " in capsys.readouterr().out


@pytest.mark.long
def test_a_mirror_is_read_and_every_method_has_a_figure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(rivals, "TREES", 10)
    arm, rng = load_arm("ur5"), np.random.default_rng(2)
    q = np.radians(np.round(rng.uniform(-60.0, 60.0, (60, 6)), 4))
    true = model_of(arm, effects_at(arm, "offsets"), {"offsets.joint2.theta_rad": 0.01, "offsets.joint3.a_mm": 1e-3})
    nominal, tip = (1e3 * solve_equilibrium(model, poses_of(q)).tcp for model in (model_of(arm, ()), true))
    columns = [
        *(f"{axis}_t" for axis in "xyz"),
        *(f"{axis}_dif" for axis in "xyz"),
        *(f"joint_{k}" for k in range(1, 7)),
    ]
    rows = np.column_stack([nominal, tip - nominal + rng.normal(0.0, 0.05, tip.shape), np.degrees(q)])
    path = tmp_path / SOURCE.repository / SOURCE.path
    path.parent.mkdir(parents=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n")
    run(monkeypatch, "--mirror", str(tmp_path))
    figures = [float(line.split()[-5]) for line in capsys.readouterr().out.splitlines() if "held out" in line]
    assert len(figures) == 5
    drawn, rigid, *_, ours = figures
    assert drawn > 3.0
    assert rigid < 0.3
    assert ours < 0.3


@pytest.mark.long
@pytest.mark.soak
def test_placements_that_no_method_saw_are_predicted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Two sockets at three placements of an arm with hidden errors: what is left of them is the encoders' noise."""
    monkeypatch.setattr(rivals, "TREES", 10)
    (source,) = (one for one in SOURCES if isinstance(one, TouchSource))
    arm, rng = load_arm("so101"), np.random.default_rng(3)
    limits = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    root, true = tmp_path / source.repository, model_of(arm, effects_at(arm, "offsets"), HIDDEN)
    for number, (name, stand) in enumerate(STANDS.items()):
        (root / source.path / name).mkdir(parents=True)
        for hole, x in zip(HOLES, (0.0, 0.05), strict=True):
            goal = (placement_motion(stand) @ [x, 0.0, 0.0, 1.0])[:3]
            q = at_goals(true, np.tile(goal, (6, 1)), number)
            read = np.clip(q + rng.normal(0.0, np.radians(0.02), q.shape), *limits)
            np.savetxt(root / source.path / name / hole, read, delimiter=",")
    text = ElementTree.tostring(bare_urdf(arm).tree, encoding="unicode")
    (root / source.urdf).parent.mkdir(parents=True)
    (root / source.urdf).write_text(text)
    own = replace(source, placements=tuple(STANDS), tip="tcp")
    monkeypatch.setattr(program, "SOURCES", (own,))
    run(monkeypatch, "--mirror", str(tmp_path))
    drawn, rigid, *_, ours = (float(line.split()[-5]) for line in capsys.readouterr().out.splitlines()[1:])
    assert drawn > 1.0
    assert rigid < 0.5 * drawn
    assert ours < 0.5 * drawn


def step(q: Array) -> Array:
    """(N, 3), a residual (m) with a jump, which no smooth function and no rigid arm has."""
    return np.where(q[:, :1] > 0.0, 1e-3, -1e-3) * np.array([1.0, 0.5, 0.0])


@pytest.mark.long
@pytest.mark.parametrize("learn", [rivals.boosting, rivals.gaussian_process])
def test_rivals_learn_what_follows_the_angles(learn: object) -> None:
    rng = np.random.default_rng(1)
    q, unseen = rng.uniform(-1.0, 1.0, (400, 3)), rng.uniform(-1.0, 1.0, (200, 3))
    left = learn(q, step(q), unseen) - step(unseen)  # type: ignore[operator]
    assert np.sqrt((left**2).mean()) < 0.5 * np.sqrt((step(unseen) ** 2).mean())
