"""References to effects and parameters: text and back, and no other file that builds or parses such a text."""

from __future__ import annotations

import re

import pytest

from lrm_math.arm.arm import Arm
from lrm_math.effects import ALL_EFFECTS, Effect
from lrm_math.effects.reference import EffectRef, ParameterRef, effect_of
from tests.conftest import ROOT
from tests.support.source_files import files

BY_HAND = re.compile(
    r"""(partition|split)\(['"](@|<-)['"]\)|place\.split\(|\D\}(@|<-)\{|['"](@|<-)['"]\.join"""
    r"""|\bkey\.(r?split\(['"]\.|r?partition\(['"]\.|startswith\(['"(])"""
)
"""Names of effects, of pairs of joints and of parameters that are built or parsed."""
STANDING_ALONE = ("reference.py", "place_names.py", "score.py")
"""References, places, and the benchmark's scorer, which needs Python alone."""


@pytest.mark.parametrize("kind", ALL_EFFECTS, ids=lambda kind: kind.id)
def test_names_and_keys_are_the_texts_of_their_references(lab: Arm, kind: type[Effect]) -> None:
    for place in kind.places(lab):
        effect = kind(lab, place)
        assert str(EffectRef.parse(effect.name)) == effect.name
        for key, parameter in zip(effect.keys, effect.parameters, strict=True):
            reference = ParameterRef.parse(key)
            assert str(reference) == key
            assert reference == (*EffectRef.parse(effect.name), parameter.name)
            assert effect_of(key) == effect.name


def test_no_place_stands_for_all_of_them() -> None:
    assert str(EffectRef.parse("backlash")) == "backlash"


def test_a_key_has_three_parts() -> None:
    with pytest.raises(ValueError, match="not enough"):
        ParameterRef.parse("backlash.joint2")


def test_names_are_built_and_parsed_in_one_place() -> None:
    plug_ins = ("lrm_ros2", "lrm_skills", "lerobot_robot_lrm")
    packages = ("lrm_math", "lrm_ident", "lrmd", *plug_ins, "validation", "examples")
    paths = [path for package in packages for path in files(package)]
    by_hand = {
        str(path.relative_to(ROOT)): [found.group() for found in BY_HAND.finditer(path.read_text(encoding="utf-8"))]
        for path in paths
        if path.name not in STANDING_ALONE
    }
    assert not any(by_hand.values()), {path: found for path, found in by_hand.items() if found}
