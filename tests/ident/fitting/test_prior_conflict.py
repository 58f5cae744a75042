"""An arm file that is wrong by more than parts are printed: the fit corrects it, and says so."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import lrm_ident as lrm
from lrm_ident.fitting.prior_conflict import unusual_dimensions
from lrm_math.arm.arm_file import shipped_arms
from tests.conftest import EXAMPLE
from tests.support.commands import stdout_of


def drawn_otherwise(folder: Path, old: str, new: str) -> Path:
    """The rig's arm file with another dimension."""
    path = folder / "arm.toml"
    text = shipped_arms()["lrm-lab"].read_text(encoding="utf-8").replace('"lrm-lab"', '"mine"')
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.long
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("extra_z_mm = 103.505", "extra_z_mm = 58.505", {"offsets.joint2.extra_z_mm", "offsets.joint3.d_mm"}),
        ("alpha_deg = -90.0", "alpha_deg = -80.0", {"offsets.joint2.alpha_rad"}),
        ("extra_z_mm = 103.505", "extra_z_mm = 104.505", set()),
    ],
)
def test_a_dimension_far_from_the_arm_file_is_named(tmp_path: Path, old: str, new: str, said: set[str]) -> None:
    data = tmp_path / "data.csv"
    shutil.copy(EXAMPLE, data)
    arm = drawn_otherwise(tmp_path, old, new)
    fitted = lrm.Study.of(lrm.load(data, arm)).fit()
    assert set(unusual_dimensions(fitted.taken.fit)) == said
    printed = stdout_of("fit", str(data), "--arm", str(arm))
    assert ("Far from the arm file: " in printed) is bool(said)
    assert all(f"{key.rpartition('_')[0]} by " in printed for key in said)


@pytest.mark.parametrize(
    ("sizes", "told", "named"), [(2.9, 0.6, False), (-3.1, 0.6, True), (3.1, 0.45, False), (3.1, 0.55, True)]
)
def test_far_is_what_the_poses_determine_beyond_three_typical_sizes(sizes: float, told: float, named: bool) -> None:
    key = "offsets.joint2.d_mm"
    model = SimpleNamespace(
        free=(key,), value=lambda _: sizes * 1e-3, parameter=lambda _: SimpleNamespace(typical=1e-3)
    )
    fit: Any = SimpleNamespace(model=model, told=[told])
    assert unusual_dimensions(fit) == ((key,) if named else ())
