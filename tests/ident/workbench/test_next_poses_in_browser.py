"""Next poses on the page: chosen against the strongest rival, as a file, as the command of that name does it."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest

from lrm_ident.workbench.work.next_poses import rival_pairs
from tests.support.browser import BrowserLog, RunningWorkbench, idle, opened, press, shot, unfold, wait_for
from tests.support.commands import stdout_of

SIZE = {"width": 1280, "height": 800}
RANKED = "lrm.state.values.ranking.length > 0"


@pytest.mark.slow
def test_next_poses_are_those_of_the_command(browser: Any, small: RunningWorkbench, tmp_path: Path) -> None:
    seen = BrowserLog()
    page = opened(browser, small, SIZE, seen)
    idle(page, RANKED)
    press(page, "next poses")
    page.wait_for_selector("#lrm-search")
    assert "poses will show whether it is backlash in joint 2 or " in page.inner_text("#lrm-search .lrm-verdict")
    wait_for(page, "lrm.scenes['next-arms']?.content.arms.length === 55")
    unfold(page)
    words = page.inner_text("#lrm-search")
    assert "Cosine between the motions of backlash in joint 2 and " in words
    shot(page, "next-poses.png")
    with page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    assert download.value.suggested_filename.endswith("-next.csv")
    poses = Path(download.value.path()).read_text(encoding="utf-8")
    assert len(poses.splitlines()) == 56, "a header, 50 poses, 5 of them again"
    page.click("[data-name=close-search]")
    press(page, "commands")
    done = page.inner_text("#lrm-commands").splitlines()[-1]
    *command, _, _ = shlex.split(done)[1:]
    stdout_of(*command, "-o", tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_text(encoding="utf-8") == poses
    page.context.close()
    assert not seen.errors, seen.errors


@pytest.mark.slow
def test_what_cannot_be_chosen_is_said_in_the_dialog_of_the_own_file(browser: Any, small: RunningWorkbench) -> None:
    """Model files that were broken from outside."""
    page = opened(browser, small, SIZE)
    idle(page, RANKED)
    whole = {model: model.read_bytes() for model in small.folder.glob("step-*.toml")}
    for model in whole:
        model.write_text("schema = 'broken'")
    press(page, "next poses")
    page.wait_for_selector("#lrm-search [role=alert]")
    assert "part.csv" in page.inner_text("#lrm-search")
    assert "schema" in page.inner_text("#lrm-search [role=alert]")
    shot(page, "next-poses-refused.png")
    assert not page.get_by_role("button", name="Download").count()
    page.context.close()
    for model, content in whole.items():
        model.write_bytes(content)


def advice(effect: str, verdict: str, *rivals: str) -> dict[str, object]:
    """An entry of a ranking."""
    return {"effect": effect, "place": "joint2", "verdict": verdict, "indistinguishable_from": rivals}


def test_rivals_are_what_the_data_cannot_tell_apart_then_the_next_ones() -> None:
    a, b = advice("a", "supported"), advice("b", "no_evidence")
    assert rival_pairs([a, b]) == (("a@joint2", "b@joint2"),)
    apart = advice("a", "indistinguishable", "c@joint3")
    assert rival_pairs([apart, b]) == (("a@joint2", "c@joint3"), ("a@joint2", "b@joint2"))
    assert rival_pairs([a]) == (("a@joint2",),)
    assert rival_pairs([b, a]) == rival_pairs([]) == ((),)
