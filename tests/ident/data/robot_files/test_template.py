"""The arm file that `arm new` writes: valid as it stands, and with the examples in its comments."""

from __future__ import annotations

from pathlib import Path

from lrm_ident.data.robot_files.arm_text import template
from lrm_math.arm.arm_file import read_arm


def test_the_shapes_in_its_comments_are_shapes_when_the_marks_are_taken_away(tmp_path: Path) -> None:
    text = template("my-arm")
    start = text.index("# [[capsule]]")
    shaped = text[:start] + "\n".join(line.removeprefix("#").strip() for line in text[start:].splitlines())
    for name, written, capsules, boxes in (("plain", text, 0, 0), ("shaped", shaped, 1, 1)):
        path = tmp_path / f"{name}.toml"
        path.write_text(written, encoding="utf-8")
        arm = read_arm(path)
        assert arm.name == "my-arm"
        assert (len(arm.shapes.capsules), len(arm.shapes.boxes)) == (capsules, boxes)
