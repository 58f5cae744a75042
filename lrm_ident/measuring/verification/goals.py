"""Goals of a verification: drawn by a seed, from a file, or the rover's task from the drill hole to the basket."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.number_table import cell_error, numbers_of, read_csv
from lrm_ident.data.measurement_file.pose_quantity import QUATERNION
from lrm_ident.data.rigid_motion import rotation_matrix
from lrm_ident.data.table_text.csv_file import CsvTable
from lrm_ident.design.candidate_poses import ClearanceRules, keeps_rules
from lrm_ident.design.workspace.voxel_grid import Area, default_study, parse_area
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.goal import Goal, point, pose
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

RULES = ClearanceRules(0.035, 0.1, 0.05)
"""Clearances of the angles that goals are drawn from: a little more than the daemon wants."""
TASK_RULES = ClearanceRules(0.035, 0.0)
"""The same where the tip has to come near the ground or the rover."""
HIGHEST_SHARE = 0.8
"""Share of a joint's range that goals use: the edge of the reach is reached by some models and not by others."""
TASK = "hole-to-basket"
ROUNDS = 6
"""Number of times that a sample is carried."""
PLACES = {"ground": "drill hole", "basket": "basket"}
"""Areas of the arm's workspace study that the task goes between (Conenna 2024, section 3.1), and what is there."""
ABOVE = 0.06
"""m: goals are so high above an area, since a daemon's guard lets nothing touch the ground unless it is permitted."""
UNIT = 0.01
"""Of a quaternion's length."""
TRIES, AT_ONCE = 100, 5000


@dataclass(frozen=True)
class PlacedGoal:
    """A goal of the tip (m). `place`: what is there, in words; empty for goals that are anywhere.

    `rotation`: rows of the tool's rotation matrix there, None where any will do.
    """

    position: tuple[float, ...]
    place: str = ""
    rotation: tuple[tuple[float, ...], ...] | None = None

    @property
    def goal(self) -> Goal:
        """The goal of inverse kinematics."""
        return point(self.position) if self.rotation is None else pose(self.position, self.rotation)


def goals_named(text: str, arm: Arm, seed: int) -> tuple[PlacedGoal, ...]:
    """Goals: so many at random, those of a CSV with `x_mm, y_mm, z_mm`, or of `TASK`, in order. Raises `LrmError`."""
    if text == TASK:
        return _task(arm, seed)
    if text.isdecimal() and 0 < int(text) <= 1000:
        drawn = draw_goals(arm, int(text), seed)
    else:
        table = read_csv(Path(text), ["x_mm", "y_mm", "z_mm"])
        drawn = np.stack([numbers_of(table, name) for name in ("x_mm", "y_mm", "z_mm")], axis=1) * MM
        if set(QUATERNION) <= {column.name for column in table.columns}:
            return _turned(table, drawn)
    return tuple(PlacedGoal(tuple(goal)) for goal in drawn.tolist())


def _turned(table: CsvTable, places: Array) -> tuple[PlacedGoal, ...]:
    """Goals at places (N, 3), m, with the orientations of a table. Raises `FileError`: not of length one."""
    q = np.stack([numbers_of(table, name) for name in QUATERNION], axis=1)
    length = np.linalg.norm(q, axis=1)
    if (wrong := np.abs(length - 1.0) > UNIT).any():
        row = int(np.argmax(wrong))
        raise cell_error(table, row, "qw", f"the quaternion's length is {length[row]:.3g}", "it must be one")
    turns = rotation_matrix(q / length[:, None]).tolist()
    return tuple(
        PlacedGoal(tuple(place), "", tuple(map(tuple, turn)))
        for place, turn in zip(places.tolist(), turns, strict=True)
    )


def draw_goals(arm: Arm, count: int, seed: int, area: Area | None = None) -> Array:
    """(count, 3), tips (m) of the nominal arm at random angles, the same for every model.

    In the middle of the joints' ranges, or, within an area, anywhere. Raises `LrmError`: hardly any keeps clear.
    """
    share, rules = (HIGHEST_SHARE, RULES) if area is None else (1.0, TASK_RULES)
    rng = np.random.default_rng([seed, 2])
    low, high = share * np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    drawn = np.empty((0, 3))
    for _ in range(TRIES):
        q = rng.uniform(low, high, size=(AT_ONCE, arm.dof))
        tips = solve_equilibrium(model_of(arm, ()), poses_of(q)).tcp
        inside = np.ones(len(q), dtype=np.bool_) if area is None else area.holds(tips)
        drawn = np.concatenate([drawn, tips[inside][keeps_rules(arm, q[inside], rules)]])
        if len(drawn) >= count:
            return drawn[:count]
    where = "" if area is None else f" at the {area.name}"
    raise LrmError(f"{arm.name}: hardly any pose{where} keeps clear of everything")


def _task(arm: Arm, seed: int) -> tuple[PlacedGoal, ...]:
    """Goals from above a drill hole to above the basket and back, `ROUNDS` times, each over another place."""
    areas = {area.name: area for area in map(parse_area, default_study(arm.name).areas)}
    missing = [name for name in PLACES if name not in areas]
    if missing:
        raise LrmError(f"--goals {TASK}: no {missing[0]} is known for {arm.name}; give its goals as a CSV")
    legs = [
        [PlacedGoal(tuple(goal), words) for goal in draw_goals(arm, ROUNDS, seed, areas[name].raised(ABOVE)).tolist()]
        for name, words in PLACES.items()
    ]
    return tuple(chain.from_iterable(zip(*legs, strict=True)))
