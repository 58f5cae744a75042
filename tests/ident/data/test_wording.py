"""Figures in words: digits by the size of the error, or of the difference that is shown."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.wording import (
    arrow,
    change_words,
    fall,
    in_minutes,
    in_percent,
    named_joints,
    p_words,
    poses_words,
    quantity,
    with_error,
)
from lrm_math.arm.arm_file import load_arm
from lrm_math.plausibility import PlausibleEstimate


@given(st.floats(-1e4, 1e4), st.floats(1e-9, 1e4))
def test_the_error_has_two_digits_and_the_value_as_many_decimals(value: float, error: float) -> None:
    shown, uncertainty = with_error(value, error)
    assert abs(float(uncertainty) - error) <= 0.051 * error
    assert abs(float(shown) - value) <= 0.051 * error + 1e-9
    assert len(shown.partition(".")[2]) == len(uncertainty.partition(".")[2])
    assert len(uncertainty.replace(".", "").lstrip("0")) == 2 or error >= 99.5


@given(st.floats(1e-6, 0.1), st.floats(1e-6, 0.1))
def test_a_fall_shows_what_lies_between(before: float, after: float) -> None:
    first, last = fall(before, after).removeprefix("from ").split(" to ")
    if abs(before - after) >= 1e-9:
        assert first != last


@pytest.mark.parametrize(("value", "error", "shown"), [
    (0.0000131, 0.0000004, "0.00001310 ± 0.00000040"),
    (2.66667, 0.0926, "2.667 ± 0.093"),
    (1.0, 4.96e11, "1 ± unknown"),
    (-0.001, 0.18, "0.00 ± 0.18"),
    (3.0, float("nan"), "3 ± unknown"),
])  # fmt: skip
def test_quantities(value: float, error: float, shown: str) -> None:
    assert quantity(value, error) == shown


def test_times_and_implausible_sizes() -> None:
    assert [in_minutes(seconds) for seconds in (0.2, 45.0, 600.0, 7200.0)] == ["1 s", "45 s", "10 min", "2.0 h"]
    assert not PlausibleEstimate(usual=0.2, largest=0.5).admits(-1.2, 0.1)
    assert PlausibleEstimate(usual=0.2, largest=0.5).admits(1.2, 0.4), "it may be small, by two standard errors"


@given(st.floats(0.0, 1.0))
def test_a_share_is_within_half_a_percent_and_a_small_one_is_not_zero(share: float) -> None:
    off = abs(float(in_percent(share)) / 100.0 - share)
    assert off <= (0.0051 if share >= 0.01 else 0.06 * share)
    assert (float(in_percent(share)) == 0.0) == (share == 0.0)


@given(st.floats(0.0, 1.0))
def test_a_p_value_is_never_said_to_be_zero(p_value: float) -> None:
    relation, number = p_words(p_value).split()
    assert float(number) > 0.0
    assert relation == ("=" if p_value >= 1e-15 else "<")
    assert relation == "<" or abs(float(number) - p_value) <= 0.5 * p_value


@given(st.floats(1e-6, 0.1), st.floats(1e-6, 0.1))
def test_an_error_falls_to_less_and_rises_to_more_or_stays(before: float, after: float) -> None:
    words = change_words(before, after)
    if abs(after - before) < 5e-4 * before:
        assert words.startswith("stayed at")
        return
    assert words.startswith("rose" if after > before else "fell")
    assert words.endswith("% more)" if after > before else "% less)")
    assert "-" not in words.partition("(")[2].replace("e-", "")


def test_an_error_that_no_digit_tells_apart_stays() -> None:
    assert change_words(4.961396e-3, 4.961397e-3) == "stayed at 4.96 mm"


@given(st.lists(st.integers(1, 999), min_size=1))
def test_one_pose_is_no_poses(numbers: list[int]) -> None:
    assert poses_words(numbers).split(" ")[0] == ("pose" if len(numbers) == 1 else "poses")


def test_joints_that_have_names_are_called_by_them() -> None:
    assert named_joints(load_arm("so101")).startswith("; joint 1 shoulder_pan, 2 shoulder_lift, 3 elbow_flex")
    assert named_joints(load_arm("lrm-lab")) == ""


@given(st.floats(1e-6, 0.1), st.floats(1e-6, 0.1))
def test_a_fall_shows_a_difference_where_there_is_one(before: float, after: float) -> None:
    first, second = map(float, arrow(before, after).split(" → "))
    assert (first == second) <= (abs(before - after) < 1e-9)
    assert abs(first - before * 1e3) <= 0.005
    assert abs(second - after * 1e3) <= 0.005
