"""Files of motion models that are older than a parameter."""

from __future__ import annotations

from pathlib import Path

import pytest

from lrm_math.errors import FileError
from lrm_math.motion.motion_model import load_motion
from tests.support.motion_models import motion_text, swinging

MASS = '"swing.joint2.mass_ratio" = 0.0\n'
TEXT = motion_text(swinging(joint2=(4.0, 0.05)))


def test_a_swing_that_states_no_mass_pushes_nothing_back(tmp_path: Path) -> None:
    path = tmp_path / "motion.toml"
    path.write_text(TEXT.replace(MASS, ""))
    assert MASS in TEXT
    assert load_motion(path)[1].values["swing.joint2.mass_ratio"] == 0.0


def test_a_swing_without_a_frequency_is_none(tmp_path: Path) -> None:
    path = tmp_path / "motion.toml"
    path.write_text(TEXT.replace('"swing.joint2.frequency_Hz" = 4.0\n', ""))
    with pytest.raises(FileError, match=r"no value of swing\.joint2\.frequency_Hz"):
        load_motion(path)
