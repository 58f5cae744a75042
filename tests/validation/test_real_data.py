"""`make real-data` skips without a network, with the reason, and reads a local mirror alike."""

from __future__ import annotations

from pathlib import Path
from urllib.error import URLError

import numpy as np
import pytest

from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation.real_data import rivals, sources
from validation.real_data.__main__ import main

SOURCE = sources.SOURCES[0]


def test_without_a_network_it_is_skipped_and_the_reason_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def unreachable(address: str, timeout: float) -> None:
        assert SOURCE.commit in address
        assert timeout > 0.0
        raise URLError("no route to host")

    monkeypatch.setattr(sources, "urlopen", unreachable)
    main([])
    said = capsys.readouterr().out
    assert said.count("skipped: https://") == len(sources.SOURCES)
    assert "no route to host; give --mirror FOLDER where there is no network" in said
    main(["--mirror", str(tmp_path)])
    assert "skipped: no " in capsys.readouterr().out


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
    main(["--mirror", str(tmp_path)])
    figures = [float(line.split()[-5]) for line in capsys.readouterr().out.splitlines() if "held out" in line]
    assert len(figures) == 5
    drawn, rigid, *_, ours = figures
    assert drawn > 3.0
    assert rigid < 0.3
    assert ours < 0.3


def step(q: Array) -> Array:
    """(N, 3), a residual (m) with a jump, which no smooth function and no rigid arm has."""
    return np.where(q[:, :1] > 0.0, 1e-3, -1e-3) * np.array([1.0, 0.5, 0.0])


@pytest.mark.parametrize("learn", [rivals.boosting, rivals.gaussian_process])
def test_rivals_learn_what_follows_the_angles(learn: object) -> None:
    rng = np.random.default_rng(1)
    q, unseen = rng.uniform(-1.0, 1.0, (400, 3)), rng.uniform(-1.0, 1.0, (200, 3))
    left = learn(q, step(q), unseen) - step(unseen)  # type: ignore[operator]
    assert np.sqrt((left**2).mean()) < 0.5 * np.sqrt((step(unseen) ** 2).mean())
