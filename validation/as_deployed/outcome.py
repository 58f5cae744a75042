"""One world through fit and `auto`, and the error of what is deployed before and after."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.diagnosis.auto import AutoRun
from lrm_ident.diagnosis.step import Step
from lrm_ident.study.study import Study
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.deployed_model import as_deployed, as_deployed_at, deployed_part
from lrm_math.model.equilibrium import Equilibrium, batch_equilibrium
from lrm_math.model.uncertainty import prediction_covariance
from lrm_math.model.unseen_states import beyond_session
from validation.as_deployed.recording import WorldRecording, as_known_to_a_rover
from validation.hidden_effects.data import NOISE_M

NOISE_MM = 1e3 * NOISE_M * float(np.sqrt(3.0))
"""RMS of a measurement's noise, all axes together."""
WORSE, WORSE_BEYOND = 1.05, 1.20
Record = dict[str, Any]


def examined(run: WorldRecording, floor: bool = False) -> Record:
    """Figures of a world. Raises nothing that a fit raises: `trouble` says it.

    Keys, with WHEN = `before` (the plain fit), `after` (`auto`), `floor` (the plain fit that knows gravity), each after
    a restart, when nothing is known of before; `before_recorded`, `after_recorded`: by a daemon that was never off.
        WHEN_mm, WHEN_max_mm: RMS and largest error as deployed at fresh poses, without noise. WHEN_unsettled: poses
            without equilibrium.
        WHEN_sd_mm: RMS standard deviation that the daemon states there.
        shown_WHEN_mm, stated_WHEN_mm: held-out RMS that the tool states, in the session and as deployed;
            stated_restarted_WHEN_mm: where nothing is known of before.
        steps: see `steps_of`. verdict: of `auto` in the end. seconds: of this record.
    """
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="as-deployed-") as folder:
        try:
            record = _examined(run, Path(folder), floor)
        except (LrmError, RuntimeError, np.linalg.LinAlgError, ValueError) as problem:  # one must not end a long run
            record = {"trouble": f"{type(problem).__name__}: {problem}"}
    return record | {"seconds": round(time.perf_counter() - began, 1)}


def _examined(run: WorldRecording, folder: Path, floor: bool) -> Record:
    data, recorded = run.load(folder)
    fresh = as_known_to_a_rover(recorded)
    plain = Study.of(data).fit(loss=run.loss)
    record: Record = _errors("before", plain, fresh, run.tips_m)
    record |= _errors("before_recorded", plain, recorded, run.tips_m)
    if floor:
        known, _ = run.load(folder, run.arm_with_known_gravity(folder))
        informed = Study.of(known).fit(loss=run.loss)
        record |= _errors("floor", informed, fresh, run.tips_m)
    found, named = plain.auto()
    record |= _errors("after", named, fresh, run.tips_m)
    record |= _errors("after_recorded", named, recorded, run.tips_m)
    return record | {
        **_stated("before", found.steps[0]),
        **_stated("after", found.steps[-1]),
        "steps": steps_of(found),
        "verdict": found.verdict,
    }


def _errors(when: str, study: Study, fresh: Poses, tips_m: Array) -> Record:
    """Errors at fresh poses as deployed; `unsettled` counts those that the model has no equilibrium for."""
    deployed = as_deployed_at(study.model, fresh)
    settled, rows = batch_equilibrium(deployed, fresh)
    error = settled.tcp - tips_m[rows]
    found = {
        f"{when}_mm": _short(1e3 * error_stats(error).rms),
        f"{when}_max_mm": _short(1e3 * error_stats(error).max),
        **_stated_sd(when, study, settled),
    }
    return found if len(rows) == len(fresh) else found | {f"{when}_unsettled": len(fresh) - len(rows)}


def _stated_sd(when: str, study: Study, settled: Equilibrium) -> Record:
    model, known = study.model, study.covariance
    if known is None:
        return {}
    whole = prediction_covariance(settled, known.marginal(model, deployed_part(as_deployed(model))))
    if whole is None:
        return {}
    followed = [beyond_session(model, settled.poses.take(np.array([row]))) for row in range(len(settled.poses))]
    square = np.einsum("nii->n", whole).mean() + np.mean([np.square(laws).sum() for laws in followed])
    return {f"{when}_sd_mm": _short(1e3 * float(np.sqrt(square)))}


def _stated(when: str, step: Step) -> Record:
    """Held-out errors that the tool states, of measurements with their noise: in the session, and as deployed."""
    shown = {f"shown_{when}_mm": _short(1e3 * step.held_out_rms)}
    stated = None if step.held_out is None else step.held_out.deployed
    if stated is None:
        return shown
    restarted = stated.time_unknown or stated.now
    known = {f"stated_{when}_mm": stated.now, f"stated_restarted_{when}_mm": restarted}
    return shown | {name: _short(1e3 * error.rms) for name, error in known.items()}


def steps_of(found: AutoRun) -> list[Record]:
    """Each step with its claim and all that it may stand for."""
    claims = [one.kind for one in found.attributions]
    return [
        {"added": step.added, "claim": claim, "names": [*step.names]}
        for step, claim in zip(found.steps[1:], claims, strict=True)
    ]


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def ratio(record: Record, known: str = "") -> float | None:
    """Error after `auto` over that before; infinite where the model after has no equilibrium and that before has.

    `known`: "_recorded" for the errors of a daemon that was never off, else those after a restart.
    """
    before, after = f"before{known}", f"after{known}"
    if f"{after}_mm" not in record:
        return None
    if record.get(f"{after}_unsettled", 0) > record.get(f"{before}_unsettled", 0):
        return float("inf")
    return float(record[f"{after}_mm"] / record[f"{before}_mm"])


def over_stated_sd(record: Record) -> float | None:
    """Error after `auto` over the standard deviation that the daemon states there; None: it states none.

    The larger one of a daemon that was never off and of one after a restart.
    """
    whens = [when for when in ("after", "after_recorded") if f"{when}_sd_mm" in record]
    return max((float(record[f"{when}_mm"] / record[f"{when}_sd_mm"]) for when in whens), default=None)


def stated_off(record: Record) -> float | None:
    """Error that the tool states as deployed over that at fresh poses, with noise, less one; None: it states none.

    The larger one of a daemon that was never off and of one after a restart, each beside what is stated for it.
    """
    pairs = (("stated_after_mm", "after_recorded_mm"), ("stated_restarted_after_mm", "after_mm"))
    off = [record[said] / np.hypot(record[true], NOISE_MM) - 1.0 for said, true in pairs if {said, true} <= {*record}]
    return float(max(off, key=abs)) if off else None
