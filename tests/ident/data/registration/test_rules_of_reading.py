"""Rules of the check of reading, one case on either side of each, without a fit."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lrm_ident.data.registration import reading_check
from lrm_ident.data.registration.hypotheses import Hypothesis, joint_hypotheses
from lrm_ident.data.registration.point_set import ScoredReading
from lrm_ident.data.registration.reading_check import ReadingCheck, check_reading
from lrm_math.arm.arm import Arm
from lrm_math.model.reading import AS_NAMED

Patch = pytest.MonkeyPatch


def scored(share: float, name: str = "", complexity: int = 1, overdetermined: bool = True) -> ScoredReading:
    hypothesis: Any = SimpleNamespace(words=name, complexity=complexity)
    return ScoredReading(hypothesis, share, 1.0, overdetermined)


@pytest.mark.parametrize(
    ("read", "other", "right"),
    [
        (0.009, 0.001, True),  # as good as any
        (0.05, 0.03, True),  # another reading is better, but not twice as good
        (0.05, 0.02, False),
        (0.29, 0.2, True),
        (0.31, 0.3, False),  # another arm's, even if no reading is better
    ],
)
def test_when_data_may_be_taken_as_they_were_read(read: float, other: float, right: bool) -> None:
    assert ReadingCheck(scored(read), (scored(other),)).right is right


def test_few_poses_are_held_to_the_largest_error_alone() -> None:
    assert ReadingCheck(scored(0.25, overdetermined=False), (scored(0.001),)).right
    assert not ReadingCheck(scored(0.35, overdetermined=False), ()).right


def found(lab: Arm, patch: Patch, read: ScoredReading, *others: ScoredReading) -> list[str]:
    """Names of the readings that a check finds among some, the data being read as `read`."""
    poses: Any = SimpleNamespace(q=np.arange(12.0)[:, None], take=lambda _: poses)
    data: Any = SimpleNamespace(poses=poses, tcp=np.zeros((12, 3)), source=SimpleNamespace(stated=None))
    patch.setattr(reading_check, "compared_rows", lambda _: np.arange(12))
    patch.setattr(reading_check, "nominal_tcp", lambda *_: np.eye(3))
    patch.setattr(reading_check.PointSet, "as_read", None)
    patch.setattr(reading_check.PointSet, "scored", lambda *_: read)
    patch.setattr(reading_check, "_hung_otherwise", lambda *_: ())
    patch.setattr(reading_check, "_alternatives", lambda _: iter(others))
    for name in ("_other_arms", "_unrelated_columns", "_shifted_rows"):
        patch.setattr(reading_check, name, nothing)
    checked = check_reading(lab, data)
    return [one.hypothesis.words for one in checked.found]


def nothing(*_: object) -> Iterator[ScoredReading]:
    return iter(())


def test_of_readings_that_explain_as_much_the_simplest_is_found(lab: Arm, monkeypatch: Patch) -> None:
    plain, odd = scored(0.014, "plain", 1), scored(0.012, "odd", 3)
    assert found(lab, monkeypatch, scored(0.5, "as read", 0), odd, plain) == ["plain"]


def test_one_that_explains_much_more_is_found_though_it_is_not_simple(lab: Arm, monkeypatch: Patch) -> None:
    plain, odd = scored(0.05, "plain", 1), scored(0.012, "odd", 3)
    assert found(lab, monkeypatch, scored(0.5, "as read", 0), odd, plain) == ["odd"]


def test_a_reading_that_leaves_more_than_a_right_one_does_is_none(lab: Arm, monkeypatch: Patch) -> None:
    assert found(lab, monkeypatch, scored(0.5, "as read", 0), scored(0.16, "plain", 1)) == []


@pytest.mark.parametrize(("hung", "weightless", "sags"), [(0.7, 1.0, True), (0.8, 2.0, False), (0.7, 0.9, False)])
def test_weightless_arms_explain_less(lab: Arm, monkeypatch: Patch, hung: float, weightless: float, sags: bool) -> None:
    monkeypatch.setattr(reading_check.PointSet, "as_read", None)
    monkeypatch.setattr(reading_check.PointSet, "scored", lambda *_: scored(weightless))
    points = reading_check.PointSet(lab, None, np.zeros((0, 3)), None)  # type: ignore[arg-type]
    assert reading_check._sags_so(points, scored(1.0), scored(hung)) is sags


@pytest.mark.parametrize(("left", "moved", "hidden"), [(0.3, 0.05, True), (0.4, 0.05, False), (0.3, 0.2, False)])
def test_a_sign_hides_near_its_axis(lab: Arm, monkeypatch: Patch, left: float, moved: float, hidden: bool) -> None:
    """Where the other sign leaves a third, and hardly moves the tip."""
    sign: Any = SimpleNamespace(complexity=reading_check.SIMPLE, q="other")
    monkeypatch.setattr(reading_check, "other_signs", lambda _: [sign])
    monkeypatch.setattr(reading_check, "replace", lambda _, q: q)
    monkeypatch.setattr(
        reading_check, "nominal_tcp", lambda _, poses: np.full((1, 3), moved if poses == "other" else 0)
    )
    monkeypatch.setattr(reading_check.PointSet, "as_read", None)
    monkeypatch.setattr(reading_check.PointSet, "scored", lambda *_: scored(left))
    points = reading_check.PointSet(lab, None, np.zeros((0, 3)), None)  # type: ignore[arg-type]
    assert (reading_check._hidden_sign(points, scored(1.0)) is not None) is hidden


def test_zeros_of_two_joints_a_right_angle_off_are_tried(lab: Arm) -> None:
    """As of an arm that was drawn with its forearm level and its gripper down: no reading was found."""
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (5, lab.dof))
    turned = q.copy()
    turned[:, 2] += np.pi / 2.0
    turned[:, 3] -= np.pi / 2.0
    read = Hypothesis(AS_NAMED, turned, np.zeros((5, 3)))
    (found,) = (one for one in joint_hypotheses(read, lab) if np.allclose(one.q, q))
    assert found.words == ("the zero of joint 3 looks turned by -90 deg", "the zero of joint 4 looks turned by 90 deg")
    assert "add -90 to theta_deg of joint 3" in found.remedy
    assert "add 90 to theta_deg of joint 4" in found.remedy
