"""A class name means one thing in the project."""

from __future__ import annotations

import re
from collections import defaultdict

import pytest

from tests.conftest import ROOT
from tests.support.source_files import files

pytestmark = pytest.mark.long

CLASS = re.compile(r"^class ([A-Za-z]\w*)", re.MULTILINE)
OTHERS = ("examples", "bench", "validation", "firmware", "tests/support", "tests/soak")
PACKAGES = ("lrm_math", "lrmd", "lrm_ident", "lrm_ros2", "lrm_skills", "lerobot_robot_lrm", *OTHERS)


def test_public_class_names_are_unique() -> None:
    where: defaultdict[str, list[str]] = defaultdict(list)
    for path in (path for package in PACKAGES for path in files(package)):
        for name in CLASS.findall(path.read_text(encoding="utf-8")):
            where[name].append(str(path.relative_to(ROOT)))
    shared = [f"{name}: {', '.join(places)}" for name, places in sorted(where.items()) if len(places) > 1]
    assert not shared, "\n".join(shared)
