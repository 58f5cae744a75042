"""One arm of a fleet brought to its end: read, fitted, and `auto` with confirmation, as the commands do it.

Beside the model, a maximum a posteriori fit of all its parameters with the weak prior `vague` is kept: its mean and
covariance are what this arm contributes to the fleet, also in directions that its poses hardly determine.
"""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np
from pydantic import Field

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of
from lrm_ident.fitting.priors import WEAK, weak_prior
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.inputs import read_measurements
from lrm_ident.study.model_history import model_file, model_text
from lrm_ident.study.study import Study
from lrm_ident.study.tool_version import tool_version
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects.reference import ParameterRef
from lrm_math.errors import LrmError
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile
from lrm_math.model.step_name import FIT, StepName
from lrm_math.toml_file import StrictSchema


@dataclass(frozen=True)
class ArmTask:
    """The work on one arm, with the contents of its files: a worker need not see the disk of who asks.

    Attributes:
        stored_arm: the arm as its model file will name it: a shipped one, or a path; `arm_text`: of the arm's file.
        data_name: of the measurements, whose content is `data`; `beside`: of the file beside them, or None.
    """

    name: str
    stored_arm: str
    arm_text: str | None
    data_name: str
    data: bytes
    beside: bytes | None

    @property
    def sha256(self) -> str:
        """Hash of everything that the result depends on, the tool's version among it."""
        parts = (tool_version(), self.stored_arm, self.arm_text or "", self.data_name, self.data, self.beside or b"")
        digest = hashlib.sha256()
        for part in parts:
            content = part.encode() if isinstance(part, str) else part
            digest.update(len(content).to_bytes(8, "big") + content)
        return digest.hexdigest()


class ArmRecord(StrictSchema):
    """Record of one arm, schema `lrm/fleet-arm/2`: the file of its result.

    `reason`: why there is no model, "" if there is one; all that follows is then empty. `steps`: of `auto`, each with
    the causes that it can stand for. `tested`: the effects that its poses could show. `evidence`: the model file of the
    fit of all parameters with the prior `vague`. `seconds`: that it took on its worker.
    """

    schema_: Literal["lrm/fleet-arm/2"] = Field("lrm/fleet-arm/2", alias="schema")
    name: str
    sha256: str
    reason: str = ""
    seconds: float = 0.0
    notices: list[str] = []
    poses: int = 0
    verdict: str = ""
    steps: list[list[str]] = []
    tested: list[str] = []
    outliers: list[int] = []
    nominal_rms_mm: float | None = None
    fit_rms_mm: float | None = None
    held_out_rms_mm: float | None = None
    model: str = ""
    evidence: ModelFile | None = None


def identify_arm(task: ArmTask) -> ArmRecord:
    """Fits, diagnoses and extends the model of one arm. Never raises: what went wrong is the record's reason."""
    begun = time.monotonic()
    with TemporaryDirectory(prefix="lrm-fleet-") as scratch:
        try:
            record = _identified(task, Path(scratch))
        except LrmError as error:
            reason = str(error).replace(f"{scratch}/", "").splitlines()[0]
            record = ArmRecord(name=task.name, sha256=task.sha256, reason=reason)
        except Exception as error:  # one arm must not stop the fleet; such a record is not kept
            record = ArmRecord(name=task.name, sha256="", reason=f"unexpected {type(error).__name__}: {error}")
    return record.model_copy(update={"seconds": round(time.monotonic() - begun, 3)})


def _identified(task: ArmTask, scratch: Path) -> ArmRecord:
    data_path, arm_path = scratch / task.data_name, scratch / "arm.toml"
    data_path.write_bytes(task.data)
    if task.beside is not None:
        data_path.with_suffix(".toml").write_bytes(task.beside)
    if task.arm_text is not None:
        (scratch / "arm").mkdir()
        arm_path = scratch / "arm" / "arm.toml"
        arm_path.write_text(task.arm_text, encoding="utf-8")
    arm = load_arm(task.stored_arm if task.arm_text is None else arm_path)
    data = read_measurements(data_path, arm, task.stored_arm)
    nominal = Study.of(data)
    run, study = nominal.fit().auto()
    steps = [list(step.names) for step in run.steps[1:]]
    return ArmRecord(
        name=task.name,
        sha256=task.sha256,
        notices=list(data.source.notices),
        poses=len(study.data),
        verdict=run.verdict,
        steps=steps,
        tested=sorted({*chain(*steps), *(candidate.name for candidate in run.diagnosis.scored)}),
        outliers=list(study.data.source.left_out),
        nominal_rms_mm=nominal.nominal_error.rms * 1e3,
        fit_rms_mm=study.errors.fitted.rms * 1e3,
        held_out_rms_mm=run.steps[-1].held_out_rms * 1e3,
        model=model_text(study.file),
        evidence=evidence_of(run.model, study.data, task.stored_arm),
    )


def evidence_of(model: Model, data: Measurements, arm_name: str) -> ModelFile:
    """A model's parameters all fitted together with the weak prior (maximum a posteriori). Raises `LrmError`.

    Offsets and compliances may become negative: of arms whose true ones are near zero, those whose estimates happen to
    be below it must not be missing from the fleet's mean. All but constants are fitted, shapes (the torque that takes
    up a play) too: one arm may hardly determine them, but its sisters have the same.
    """
    keys = zip(model.keys, model.parameters, strict=True)
    whole = replace(model, free=tuple(key for key, parameter in keys if parameter.fixed is None or parameter.scan))
    signed = bounds_of(whole, whole.free)
    plain = np.array([ParameterRef.parse(key).id in DEFAULT_EFFECTS for key in whole.free])
    bounds = Bounds(np.where(plain, -np.inf, signed.lower), np.where(plain, np.inf, signed.upper))
    result = fit(whole, data, bounds, prior=weak_prior(whole))
    file = model_file(result, data, HeldOutResidual(None), arm_name, StepName(FIT), prior=WEAK)
    return file.model_copy(update={"history": [], "provenance": None})
