"""Physical sizes: an estimate far beyond them is said in one line, and no fit that needs one is a cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import ALL_EFFECTS, effects_at
from lrm_math.model.covariance import Covariance, implausible_estimates
from lrm_math.model.model import model_of

LAB = load_arm("lrm-lab")


def found(key: str, value: float, error: float) -> tuple[str, ...]:
    """Sentences on a model with one estimate (SI) and its standard error."""
    effect_id, place, _ = key.split(".")
    model = replace(model_of(LAB, effects_at(LAB, f"{effect_id}@{place}"), {key: value}), free=(key,))
    return tuple(one.sentence for one in implausible_estimates(model, Covariance((key,), np.array([[error**2]]))))


@pytest.mark.parametrize(
    ("key", "usual", "absurd", "words"),
    [
        ("eccentricity.joint2.a1_rad", 0.05, 0.55, "less than 3 deg"),
        ("measurement_frame.frame.scale_x_mm_per_m", 3e-3, 0.036, "less than 1 mm/m"),
        ("mass.link2.mass_g", 0.05, 5.0, " g"),
        ("servo_gain.joint2.g_plus_rad_per_rad", 0.03, 0.4, "rad/rad"),
        ("offsets.base.x_mm", 0.06, 0.6, " mm"),
        ("offsets.joint3.a_mm", 0.006, 0.06, " mm"),
    ],
)
def test_an_absurd_size_is_said_with_what_is_usual(key: str, usual: float, absurd: float, words: str) -> None:
    """One line with key, value and usual range; a usual size is not mentioned, nor one that may be small."""
    assert found(key, usual, 1e-4 * usual) == ()
    (sentence,) = found(key, -absurd, 1e-4 * absurd)
    assert sentence.startswith(key)
    assert words in sentence
    assert found(key, absurd, absurd) == (), "two standard errors less it is ordinary"


@pytest.mark.parametrize("kind", ALL_EFFECTS, ids=lambda kind: kind.id)
def test_a_typical_size_is_plausible_everywhere(kind: type) -> None:
    """Usual is at least typical, and the largest at least usual."""
    for place in kind.places(LAB):  # type: ignore[attr-defined]
        for parameter in kind(LAB, place).parameters:
            sizes = parameter.plausible
            assert parameter.typical <= sizes.usual <= sizes.largest, parameter.name
