"""Names of steps: `lrm/model/2` states them as structure, `lrm/model/1` is read, rivals in its sentences included."""

from __future__ import annotations

import pytest

from lrm_math.model.model_file import HistoryTable, ModelFile, as_tables
from lrm_math.model.step_name import ADD, FIT, REFIT, TRANSFER, StepName

EVERY = [StepName(FIT), StepName(ADD, "cable_curve@joint1+joint2"), StepName(REFIT, "a b"), StepName(TRANSFER, "lab")]
AFTER = {"fit_rms_mm": 1.0, "effects": [], "parameters": {}}


@pytest.mark.parametrize("name", EVERY, ids=lambda name: name.kind)
def test_a_step_of_version_1_is_read_from_its_name(name: StepName) -> None:
    assert StepName.of_version_1(str(name)) == name
    entry = HistoryTable.model_validate({"step": str(name), **AFTER})
    assert (entry.name, entry.name.added) == (name, name.of if name.kind == ADD else "")
    assert HistoryTable.model_validate(entry.model_dump(exclude_none=True)) == entry, "and as it is written now"


def test_rivals_in_a_sentence_of_version_1_are_names() -> None:
    said = "add hysteresis@joint3, or drift@joint30 and 1 more, slip@joint2: these data cannot tell"
    entry = HistoryTable.model_validate({"step": said, **AFTER})
    assert entry.name == StepName(ADD, "hysteresis@joint3")
    assert entry.indistinguishable == ["drift@joint30", "slip@joint2"]


def test_what_names_no_cause_was_said_behind_a_comma() -> None:
    assert StepName.of_version_1("add residual_field@tool, names no cause: smooth").added == "residual_field@tool"


def test_an_unknown_step_is_its_own_name() -> None:
    assert str(StepName.of_version_1("by hand, twice")) == "by hand, twice"


def test_version_1_becomes_version_2() -> None:
    file = ModelFile.model_validate({"schema": "lrm/model/1", "arm": "lrm-lab", "effects": []})
    assert as_tables(file)["schema"] == "lrm/model/2"
