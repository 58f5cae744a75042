"""Goals of a verification: the same for every model, within their areas, and what is said of where the tip landed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lrm_ident.design.workspace.voxel_grid import default_study, parse_area
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import PoseTiming, Unreachable
from lrm_ident.measuring.tracker.dwell import RestMean
from lrm_ident.measuring.verification.goal_commands import GoalCommand
from lrm_ident.measuring.verification.goal_run import AttainedPosition, GoalRun, Verification, angle_between
from lrm_ident.measuring.verification.goals import ABOVE, PLACES, ROUNDS, TASK, PlacedGoal, goals_named
from lrm_ident.measuring.verification.report import values, verification_document
from lrm_ident.report.document import ResultTable
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError

ROVER = load_arm("lrm-rover")
A = np.radians(2.0)
FOLDED = (0.0, 1.5, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.slow
def test_random_goals_are_the_same_by_their_seed() -> None:
    assert goals_named("7", ROVER, 3) == goals_named("7", ROVER, 3)
    assert goals_named("7", ROVER, 3) != goals_named("7", ROVER, 4)
    assert goals_named("7", ROVER, 3) == goals_named("9", ROVER, 3)[:7]


@pytest.mark.long
def test_the_task_goes_from_the_hole_to_the_basket_and_back() -> None:
    goals = goals_named(TASK, ROVER, 0)
    assert [goal.place for goal in goals] == ["drill hole", "basket"] * ROUNDS
    areas = {area.name: area for area in map(parse_area, default_study("lrm-rover").areas)}
    for name, words in PLACES.items():
        assert areas[name].raised(ABOVE).holds(np.array([goal.position for goal in goals if goal.place == words])).all()


def test_goals_of_a_file_keep_their_order(tmp_path: Path) -> None:
    path = tmp_path / "goals.csv"
    path.write_text("x_mm,y_mm,z_mm\n300,0,100\n-200,50,250\n")
    assert [goal.position for goal in goals_named(str(path), ROVER, 0)] == [(0.3, 0.0, 0.1), (-0.2, 0.05, 0.25)]


@pytest.mark.parametrize("text", ["0", "-3", "nothing.csv", TASK])
def test_what_names_no_goals_is_one_line(text: str) -> None:
    with pytest.raises(LrmError) as caught:
        goals_named(text, load_arm("lrm-lab"), 0)
    assert "\n" not in str(caught.value)


class WarmArm:
    """An arm that is too warm after its second goal; its first pose loads the joints more than the goals do."""

    def __init__(self) -> None:
        self.q, self.log = (0.0,) * 6, list[str]()

    def commanded(self) -> tuple[float, ...]:
        return self.q

    def go(self, pose: PlannedPose) -> None:
        self.q = pose.q
        self.log.append("goal")
        raise Unreachable("no way back")

    def too_warm(self) -> str:
        return "joint2 is hot" if self.log.count("goal") == 2 and "cool" not in self.log else ""

    def cool(self, rest: PlannedPose) -> None:
        assert rest.q == FOLDED, "of the poses reached the one that loads the joints least"
        self.log.append("cool")


def test_a_warm_arm_cools_before_the_next_goal() -> None:
    arm: Any = WarmArm()
    nothing: Any = None
    folded: Any = SimpleNamespace(model="", model_sha256="", solve=lambda *_: GoalCommand(FOLDED, 0.0, None))
    said: list[str] = []
    run = GoalRun(arm, folded, ROVER, nothing, nothing, nothing, PoseTiming(), 0.0)
    found = run.visit([PlacedGoal((0.3, 0.0, 0.1))] * 4, lambda _, words: said.append(words))
    assert arm.log == ["goal", "goal", "cool", "goal", "goal"]
    assert said.count("joint2 is hot: cooling") == 1
    assert len(found.failed) == 4


def attained(number: int, place: str, error: float, sd: float | None = 3e-4) -> AttainedPosition:
    return AttainedPosition(number, place, (0.3, 0.0, 0.1), (0.3 + error, 0.0, 0.1), 4e-4, sd, 1e-5)


def test_what_is_predicted_stands_beside_what_was_measured() -> None:
    found = Verification(
        "m.toml", "ab" * 32, (attained(1, "drill hole", 1e-3), attained(2, "basket", 2e-3)), {3: "far"}
    )
    told = values(found)
    assert told["predicted_rms_mm"] == pytest.approx(0.5)  # sqrt(0.3² + 0.4²)
    assert [row["predicted_sd_mm"] for row in told["goals"]] == pytest.approx([0.3, 0.3])
    assert [row["measured_sd_mm"] for row in told["goals"]] == pytest.approx([0.01, 0.01])
    summary, by_place, left = verification_document(found, None).blocks
    assert isinstance(summary, ResultTable)
    assert isinstance(by_place, ResultTable)
    assert [row[0] for row in by_place.cells] == ["drill hole", "basket"]
    assert [row[2] for row in by_place.cells] == pytest.approx([1.0, 2.0])
    assert left == "not reached: goal 3: far"
    assert len(verification_document(found.at("basket"), None).blocks) == 1


def test_a_model_without_covariance_predicts_no_spread() -> None:
    found = Verification("", "", (attained(1, "", 1e-3, None),), {})
    assert found.predicted is None
    assert values(found)["predicted_rms_mm"] is None


@pytest.mark.parametrize(("error", "lines"), [(2e-3, 0), (0.3, 1)])
def test_an_arm_that_is_not_the_models_any_more_is_said(error: float, lines: int) -> None:
    found = Verification("m.toml", "ab" * 32, (attained(1, "", error),), {})
    _, *said = verification_document(found, None).blocks
    assert len(said) == lines
    assert all("as the model predicts" in str(line) for line in said)


def test_the_angle_between_tool_and_wish_stands_beside_the_distance(tmp_path: Path) -> None:
    """The goals of a file have orientations; the tool is turned by 2 deg against each when it is there."""
    path = tmp_path / "goals.csv"
    path.write_text("x_mm,y_mm,z_mm,qw,qx,qy,qz\n300,0,200,0.707107,0,0.707107,0\n300,50,200,1,0,0,0\n")
    goals = goals_named(str(path), ROVER, 0)
    assert [None if one.rotation is None else one.rotation[0][0] for one in goals] == pytest.approx(
        [0.0, 1.0], abs=1e-5
    )
    about_x = np.array([[1, 0, 0], [0, np.cos(A), -np.sin(A)], [0, np.sin(A), np.cos(A)]])
    rests = [RestMean(np.array(g.position), 1e-4, 0.0, 30, np.array(g.rotation) @ about_x, 1e-3) for g in goals]
    turns = [angle_between(goal, rest) for goal, rest in zip(goals, rests, strict=True)]
    assert turns == pytest.approx([A, A], abs=1e-6)
    found = Verification("m", "", tuple(replace(attained(k, "", 1e-3), turn=t) for k, t in enumerate(turns)), {})
    told = verification_document(found, None)
    assert "The tool is 2.00 deg RMS off the orientation of its goals." in told.blocks
    assert [row["angle_deg"] for row in values(found)["goals"]] == pytest.approx([2.0, 2.0])
    assert "angle_deg" not in values(replace(found, attained=(attained(1, "", 1e-3),)))["goals"][0]


def test_an_orientation_of_another_length_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "goals.csv"
    path.write_text("x_mm,y_mm,z_mm,qw,qx,qy,qz\n300,0,200,2,0,0,0\n")
    with pytest.raises(LrmError, match="the quaternion's length is 2"):
        goals_named(str(path), ROVER, 0)
