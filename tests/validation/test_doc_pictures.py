"""Every picture of the docs is drawn by a script."""

from __future__ import annotations

from validation.doc_pictures import COMMANDS, PICTURES

OF_A_PAGE = {"social-card"}
"""Screenshots, by `validation.workbench.story`."""


def test_every_picture_has_a_script_and_every_script_a_picture() -> None:
    assert {path.stem for path in PICTURES.glob("*.png")} - OF_A_PAGE == {*COMMANDS}
