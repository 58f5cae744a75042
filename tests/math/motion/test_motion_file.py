"""Files of motion models that are older than a parameter, or than the meaning of one."""

from __future__ import annotations

from pathlib import Path

import pytest

from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.errors import FileError
from lrm_math.motion.motion_model import load_motion
from tests.support.motion_models import motion_text, swinging

MASS = '"swing.joint2.mass_ratio" = 0.0\n'
ARM = "lrm-rover"
TEXT = motion_text(swinging(ARM, joint2=(4.0, 0.05)))

OLDER = (
    motion_text(swinging())
    .replace("lrm/motion/2", "lrm/motion/1")
    .replace("effects = [", 'effects = ["gravity_sag@joint2", ')
    .replace("[parameters]", '[parameters]\n"gravity_sag.joint2.k_rad_per_Nm" = 0.02')
)
SIZES = {
    "inertial_coupling": '"inertial_coupling.joint2.k_rad_per_Nm" = 0.02\n',
    "link_inertia": '"link_inertia.joint2.s_ratio" = 0.4\n',
}


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


def test_the_arm_of_a_file_is_looked_up_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From whatever folder the command is given."""
    folder, elsewhere = tmp_path / "models", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    (folder / "mine.toml").write_text(shipped_arms()[ARM].read_text())
    path = folder / "motion.toml"
    path.write_text(TEXT.replace(f'arm = "{ARM}"', 'arm = "mine.toml"'))
    monkeypatch.chdir(elsewhere)
    assert load_motion(path)[1].arm == load_arm(ARM)


@pytest.mark.parametrize("other", ["inertial_coupling", "link_inertia"])
def test_two_effects_of_an_older_fit_that_count_one_inertia_are_to_be_fitted_again(tmp_path: Path, other: str) -> None:
    path = tmp_path / "motion.toml"
    path.write_text(OLDER.replace('"gravity_sag@joint2"', f'"gravity_sag@joint2", "{other}@joint2"') + SIZES[other])
    with pytest.raises(FileError, match=rf"gravity_sag@joint2 and {other}@joint2, .* twice; fit it again") as caught:
        load_motion(path)
    assert "\n" not in str(caught.value)
    path.write_text(path.read_text().replace("lrm/motion/1", "lrm/motion/2"))
    assert len(load_motion(path)[1].added) == 2


def test_one_effect_of_an_older_fit_that_counts_inertia_is_read(tmp_path: Path) -> None:
    path = tmp_path / "motion.toml"
    path.write_text(OLDER)
    assert load_motion(path)[1].values["gravity_sag.joint2.k_rad_per_Nm"] == 0.02
