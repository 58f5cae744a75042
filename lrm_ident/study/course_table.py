"""What a run of `auto` found, kept beside the last step of its model: what each effect is, and the nested error."""

from __future__ import annotations

from lrm_ident.diagnosis.attribution import term_of
from lrm_ident.diagnosis.auto import AutoRun
from lrm_ident.residual.error_breakdown import NestedResidual
from lrm_math.model.model_file import CourseTable, ModelFile


def with_course(file: ModelFile, course: AutoRun, nested: NestedResidual) -> ModelFile:
    """The model file with what the effects of a run are, and the error with the effects chosen anew in every fold."""
    noise, nested_error = course.report.diagnosis.floor.rms, nested.error
    shown = zip(course.steps[1:], course.attributions, strict=True)
    table = CourseTable(
        shows={step.added: term_of(attribution.kind, step.evidence.equivalent) for step, attribution in shown},
        noise_rms_mm=None if noise is None else noise * 1e3,
        nested_rms_mm=None if nested_error is None else nested_error.rms * 1e3,
        nested_deployed_rms_mm=None if nested.deployed is None else nested.deployed.now.rms * 1e3,
        nested_deployed_poses=None if nested.deployed is None else nested.deployed.fewer,
        chosen_in_folds=nested.frequency,
        folds=len(nested.chosen) if nested_error is not None else 0,
    )
    last = file.history[-1].model_copy(update={"course": table})
    return file.model_copy(update={"history": [*file.history[:-1], last]})
