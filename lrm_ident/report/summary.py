"""Summary of a model file: how the error fell, what the model consists of, what the arm gets; without any data."""

from __future__ import annotations

from collections.abc import Iterator

from lrm_ident.data.wording import change_words
from lrm_ident.report.document import Block, Document, Facts, heading
from lrm_ident.report.fit import estimate_table
from lrm_ident.report.model_report import history_table, history_values, provenance_table
from lrm_ident.report.plain_names import effects_in_words, plain_name
from lrm_ident.report.story import Story, story_of_file
from lrm_math.arm.arm_file import MM
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile

PARTS = (
    "The arm's part holds wherever the arm goes, the installation's while it stays mounted there; the measurement's is "
    "not deployed."
)


def summary_document(file: ModelFile, model: Model) -> Document:
    """Result of `lrm-ident show`, schema `lrm/summary/1`."""
    story, steps = story_of_file(file), sum(bool(entry.name.added) for entry in file.history)
    added = f", {steps} effect{'s' if steps != 1 else ''} added" if steps > 0 else ""
    headline = heading(f"Model of {file.arm}: {len(file.parameters)} parameters{added}")
    blocks: list[Block] = [headline, Facts(tuple(_facts(file, story))), "", *([] if story is None else [story.table()])]
    blocks.append(Facts(tuple((part, effects_in_words(names)) for part, names in file.parts.items() if names)))
    details: list[Block] = [PARTS, history_table(file), estimate_table(model, file.sigma), provenance_table(file)]
    values = {
        "arm": file.arm,
        "story": story,
        "effects": file.effects,
        "parts": file.parts,
        "history": history_values(file),
        "parameters": file.parameters,
        "sigma": file.sigma,
    }
    about = "every step, every parameter with its standard error, the origin"
    return Document(blocks, "lrm/summary/1", values, details=details, about=about)


def _facts(file: ModelFile, story: Story | None) -> Iterator[tuple[str, str]]:
    provenance = file.provenance
    if provenance is not None:
        yield "fitted to", f"{provenance.poses} poses of {provenance.data}, {provenance.date[:10]}"
    if not file.history:
        return
    if story is not None:
        yield "error", story.sentence
        yield from (*story.facts, *story.certainty)
    elif (after := file.history[-1].held_out_rms_mm) is not None:
        yield "held-out error", change_words((file.history[0].held_out_rms_mm or after) * MM, after * MM)
    if file.deployed is not None and file.deployed.carried:
        kept = ", ".join(f"{plain_name(name)}: {which}" for name, which in file.deployed.carried.items())
        yield "carried forward", kept
