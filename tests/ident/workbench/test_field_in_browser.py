"""The field of the page: a step of its own, marked as no cause, refused where it does not help, and taken back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.workbench.tab.command_bar import ADD_FIELD
from lrm_ident.workbench.work.tasks import FIELD
from lrm_math.effects import FIELDS, NOT_A_CAUSE, marked
from tests.support.browser import BrowserLog, RunningWorkbench, idle, opened, press, shot, wait_for, workbench
from tests.support.nameless_arm import measured

SIZE = {"width": 1280, "height": 800}
BUTTON = f"[data-name='{ADD_FIELD.lower()}']"
ONE_STEP, TWO_STEPS = "lrm.state.values.steps.length === 1", "lrm.state.values.steps.length === 2"


def nameless(folder: Path, size: float) -> Path:
    """A file of measurements with what no effect of the catalogue makes, of amplitude `size` (m)."""
    path = folder / "measurements.csv"
    path.write_text(measurements_csv(measured(1, size, count=200)), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def running(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningWorkbench]:
    assert browser
    folder = tmp_path_factory.mktemp("nameless")
    with workbench(nameless(folder, 4e-3), "--arm", "lrm-lab", cwd=folder) as found:
        yield found


def test_the_button_is_marked_as_the_catalogue_says() -> None:
    """Its words are constants, since the page is served before the catalogue is loaded."""
    assert [kind.id for kind in FIELDS] == [FIELD]
    assert marked(FIELD, "Add a field") == ADD_FIELD


@pytest.mark.slow
def test_a_field_is_a_step_that_is_marked_and_taken_back(browser: Any, running: RunningWorkbench) -> None:
    seen = BrowserLog()
    page = opened(browser, running, SIZE, seen)
    wait_for(page, ONE_STEP)
    page.click("#lrm-menu > summary")
    assert NOT_A_CAUSE in page.inner_text(BUTTON)
    assert page.eval_on_selector(f"{BUTTON} .block", "(one) => one.scrollWidth <= one.clientWidth"), "words cut off"
    idle(page, "lrm.state.values.story.held_out")
    before = page.evaluate("lrm.state.values.story.steps[1].rms_mm")
    press(page, ADD_FIELD.lower())
    wait_for(page, TWO_STEPS)
    idle(page, "lrm.state.values.ranking.length > 0")
    assert page.evaluate("lrm.state.values.story.steps[2].rms_mm") < 0.7 * before
    card = page.inner_text("#lrm-cards")
    assert NOT_A_CAUSE in card.lower()
    assert not [one for one in page.evaluate("lrm.state.values.ranking.map((one) => one.name)") if FIELD in one]
    assert marked(FIELD) in page.text_content(".lrm-numbers")
    shot(page, "field.png")
    press(page, "commands")
    assert f" {FIELD} -o " in page.inner_text("#lrm-commands")
    page.keyboard.press("Escape")
    page.wait_for_selector("#lrm-commands", state="hidden")
    press(page, "undo")
    wait_for(page, ONE_STEP)
    assert page.evaluate("lrm.state.values.story.steps[1].rms_mm") == pytest.approx(before)
    page.context.close()
    assert not seen.errors, seen.errors


@pytest.mark.soak
@pytest.mark.slow
def test_where_it_does_not_help_the_page_says_so(browser: Any, tmp_path: Path) -> None:
    with workbench(nameless(tmp_path, 0.0), "--arm", "lrm-lab", cwd=tmp_path) as running:
        page = opened(browser, running, SIZE)
        wait_for(page, ONE_STEP)
        press(page, ADD_FIELD.lower())
        page.wait_for_function("document.getElementById('lrm-failure').textContent.includes('residual field')")
        assert "does not surely predict better" in page.inner_text("#lrm-failure")
        assert page.evaluate(ONE_STEP)
        page.context.close()
