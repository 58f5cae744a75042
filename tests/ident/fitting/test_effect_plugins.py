"""Effects in a user's file: the belt of docs/effects.md, and what is said of files that are not right."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, UnknownName
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

ROOT = Path(__file__).resolve().parents[3]
BELT = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "effects.md").read_text(encoding="utf-8"), flags=re.S)[1]
STRETCH = 0.02
"""rad/Nm"""


def belt_file(folder: Path, old: str = "", new: str = "") -> Path:
    """The file of the documentation, with one text changed."""
    assert old in BELT
    path = folder / "belt.py"
    path.write_text(BELT.replace(old, new) if old else BELT)
    return path


def test_the_belt_of_the_docs_turns_a_joint_by_the_torque_on_the_one_before(tmp_path: Path) -> None:
    arm = load_arm("lrm-lab")
    catalogue = catalogue_with(belt_file(tmp_path))
    assert [effect.place for effect in effects_at(arm, "belt", catalogue)] == list(arm.joint_names[1:])
    stretched = model_of(arm, effects_at(arm, "belt@joint3", catalogue), {"belt.joint3.c_rad_per_Nm": STRETCH})
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (20, arm.dof))
    equilibrium = solve_equilibrium(stretched, poses_of(q))
    turned = q.copy()
    turned[:, 2] += STRETCH * equilibrium.joint_torque[:, 1]
    assert np.abs(turned - q).max() > 1e-3
    np.testing.assert_allclose(equilibrium.tcp, solve_equilibrium(model_of(arm, ()), poses_of(turned)).tcp, atol=1e-7)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("c_rad_per_Nm", "c_radperNm", "parameter 'c_radperNm': its name must end in its unit, one of rad, mm"),
        ("((tau[0],),)", "((tau,),)", "gives amounts of another shape"),
        ("((tau[0],),)", "(tau[0],)", "gives amounts of another shape"),
        ("    @property\n    def load_slots", "    def loads", "load_slots: the slots whose loads it reads in tau"),
        ("joint{self.joint}.theta", "joint{self.joint}.tehta", "did you mean"),
        ('id = "belt"', "", "has no id"),
        ('id = "belt"', 'id = "backlash"', "id 'backlash' is taken"),
    ],
)
def test_a_file_that_is_not_right_is_told_what_is_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(FileError, match=re.escape(message)):
        catalogue_with(belt_file(tmp_path, old, new))


def test_unknown_names_do_not_guess_at_numbers(tmp_path: Path) -> None:
    arm, catalogue = load_arm("lrm-lab"), catalogue_with(belt_file(tmp_path))
    with pytest.raises(UnknownName, match="unknown place of effect belt 'joint1'; valid: joint2, joint3"):
        effects_at(arm, "belt@joint1", catalogue)
    with pytest.raises(UnknownName, match="an effect of your own comes with its file: --effects-file"):
        effects_at(arm, "belt@joint3")
