"""Next poses to measure: a design that tells the first candidate of a diagnosis from its strongest rival."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import sqrt
from typing import Any

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.weights.whitening import measured_alike
from lrm_ident.design.advice import next_poses as designed
from lrm_ident.design.candidate_poses import ClearanceRules, clear_poses, floor_above_table
from lrm_ident.design.discrimination import UnsuitableRival
from lrm_ident.design.pose_design import DesignProblem, PoseDesign
from lrm_ident.fitting.progress import Progress
from lrm_ident.report.design import design_document, pose_table
from lrm_ident.report.document import blocks_html
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.plots.interactive.candidate_view import rounded
from lrm_ident.report.text.advice import provided_words
from lrm_ident.residual.picture.error_field import arm_lines
from lrm_ident.study.study import Study
from lrm_ident.workbench.work.tasks import DoneCommand, PosesTask, SearchResult, section_html, unpacked
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.effects import EffectRef, effects_at
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

COUNT, REPEATS, SEED = 50, 5, 0
"""As `lrm-ident design` without options."""
MOST_RIVALS = 4
"""That are tried, one after the other, until some poses are expected to tell one from the first candidate."""


def next_poses(study: Study, asked: PosesTask, progress: Progress) -> SearchResult:
    """Chooses and keeps the next poses. Raises `LrmError`: none can tell any rivals apart, or too few are clear."""
    report = unpacked(asked.packed)
    floor = report.floor_mm  # that the data show, else all that the last step leaves
    error_left = error_stats(report.field.steps[-1].residual).rms / MM if floor is None else floor
    noise_mm = float(f"{error_left / sqrt(3.0):.3g}")
    arm, data = study.model.arm, study.data
    loads_g = sorted({round(float(load) / GRAM, 3) for load in (data.poses.payload.min(), data.poses.payload.max())})
    problem = DesignProblem(
        model=study.model,
        keys=None,
        rivals=(),
        count=COUNT,
        index="O1",
        noise=noise_mm * MM,
        measured=data.poses,
        repeats=REPEATS,
        first_number=max(*data.pose.tolist(), *data.source.left_out) + 1,
        seed=SEED,
        weights=measured_alike(data.whitening),
        measured_weights=data.whitening,
    )
    refused, ticked = list[str](), partial(progress, "choosing poses")
    ranking: Any = [] if report.diagnosis is None else report.diagnosis.values["ranking"]
    rules = ClearanceRules(floor=floor_above_table(arm))
    offer = clear_poses(arm, (), [load * GRAM for load in loads_g], rules, SEED)
    best: tuple[tuple[str, ...], DesignProblem, PoseDesign] | None = None
    for names in rival_pairs(ranking):
        task = replace(problem, rivals=tuple(e for name in names for e in effects_at(arm, name, study.catalogue)))
        try:
            chosen = designed(task, offer, ticked)
        except LrmError as error:
            named = f"{plain_name(error.name)} {error.why}" if isinstance(error, UnsuitableRival) else str(error)
            refused.append(named)
            continue
        if best is None or chosen.distinguishable:
            best = names, task, chosen
        if chosen.distinguishable:
            break
    if best is None:
        raise LrmError("; ".join(dict.fromkeys(refused)))
    names, task, chosen = best
    document = design_document(task, offer, chosen)
    arguments = (study.arm, *(("--separate", ",".join(names)) if names else ()))
    arguments += ("--noise-mm", f"{noise_mm:g}", "--loads-g", ",".join(f"{load:g}" for load in loads_g))
    arguments += ("--model", str(asked.files.model), "--have", str(asked.files.data), "-o", str(asked.kept))
    shown = [*(f"Not for a stronger rival: {words.removesuffix('.')}." for words in refused), *document.whole]
    arms = arm_lines(solve_equilibrium(model_of(arm, ()), chosen.poses))
    write_text(asked.kept, pose_table(chosen).csv())
    return SearchResult(
        sentence=_sentence(names, chosen),
        words=section_html("Figures of the design", blocks_html(shown)),
        command=DoneCommand(("design", *arguments), asked.files.effects_file),
        file=asked.kept,
        arms=json.dumps(rounded(arms * 1e3, 0)),
    )


def _sentence(names: Sequence[str], chosen: PoseDesign) -> str:
    """What the poses will tell, in one sentence."""
    count = len(chosen.poses)
    if not chosen.distinguishable:
        return (
            f"No poses tried can distinguish {plain_name(names[0])} from {plain_name(names[1])}; these {count} poses "
            "make the model's parameters more certain."
        )
    if len(names) > 1:
        either = f"{plain_name(names[0])} or {plain_name(names[1])}{provided_words(chosen.pairs)}"
        return f"These {count} poses will show whether it is {either}."
    if names:
        return f"These {count} poses will show more surely whether it is {plain_name(names[0])}."
    return f"These {count} poses will make the model's parameters more certain; no effect is in doubt."


def rival_pairs(ranking: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, ...], ...]:
    """The first candidate that there is evidence for, beside each of its strongest rivals, the strongest first.

    Those come first that the data cannot tell from it, then the next ones of the ranking; one empty pair where there is
    no evidence for any: then poses are chosen for the parameters alone.
    """
    names = [str(EffectRef(candidate["effect"], candidate["place"])) for candidate in ranking]
    if not names or ranking[0]["verdict"] == "no_evidence":
        return ((),)
    rest = dict.fromkeys([*ranking[0]["indistinguishable_from"], *names[1:]])
    rest.pop(names[0], None)
    return tuple((names[0], rival) for rival in list(rest)[:MOST_RIVALS]) or ((names[0],),)
