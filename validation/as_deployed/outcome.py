"""One world through fit and `auto`, and the error of what is deployed before and after."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.diagnosis.auto import AutoRun
from lrm_ident.diagnosis.step import Step
from lrm_ident.study.study import Study
from lrm_math.arrays import Array
from lrm_math.effects import effect_of
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model import deployed_model
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model
from validation.as_deployed.recording import WorldRecording, in_shown_frame
from validation.hidden_effects.data import NOISE_M

NOISE_MM = 1e3 * NOISE_M * float(np.sqrt(3.0))
"""RMS of a measurement's noise, all axes together."""
WORSE, WORSE_BEYOND = 1.05, 1.20
Record = dict[str, Any]


def deployed(model: Model) -> Model:
    """The model that a rover uses; before there was a state that goes along, the part that lasts."""
    take: Callable[[Model], Model] | None = getattr(deployed_model, "as_deployed", None)
    take = take or getattr(deployed_model, "lasting_part")  # noqa: B009
    return take(model)


def examined(run: WorldRecording, floor: bool = False) -> Record:
    """Figures of a world. Raises nothing that a fit raises: `trouble` says it.

    Keys, with WHEN = `before` (the plain fit), `after` (`auto`), `floor` (the plain fit that knows gravity):
        WHEN_mm, WHEN_max_mm: RMS and largest error as deployed at fresh poses, without noise.
        WHEN_aligned_mm: RMS after the best rigid alignment of those poses. WHEN_unsettled: poses without equilibrium.
        shown_WHEN_mm, stated_WHEN_mm: held-out RMS that the tool states, in the session and as deployed.
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
    data, fresh = run.load(folder)
    plain = Study.of(data).fit(loss=run.loss)
    record: Record = _errors("before", deployed(plain.model), fresh, run.tips_m)
    if floor:
        known, _ = run.load(folder, run.arm_with_known_gravity(folder))
        informed = deployed(Study.of(known).fit(loss=run.loss).model)
        record |= _errors("floor", informed, fresh, run.tips_m)
    found, named = plain.auto()
    record |= _errors("after", deployed(named.model), fresh, run.tips_m)
    return record | {
        **_stated("before", found.steps[0]),
        **_stated("after", found.steps[-1]),
        "steps": steps_of(found),
        "verdict": found.verdict,
    }


def _errors(when: str, model: Model, fresh: Poses, tips_m: Array) -> Record:
    """Errors at fresh poses; `unsettled` counts those that the model has no equilibrium for."""
    settled, rows = batch_equilibrium(model, fresh)
    tips = tips_m[rows]
    error = settled.tcp - tips
    aligned = in_shown_frame(settled.tcp, tips, settled.tcp) - tips
    found = {
        f"{when}_mm": _short(1e3 * error_stats(error).rms),
        f"{when}_max_mm": _short(1e3 * error_stats(error).max),
        f"{when}_aligned_mm": _short(1e3 * error_stats(aligned).rms),
    }
    return found if len(rows) == len(fresh) else found | {f"{when}_unsettled": len(fresh) - len(rows)}


def _stated(when: str, step: Step) -> Record:
    """Held-out errors that the tool states, of measurements with their noise: in the session, and as deployed."""
    shown = {f"shown_{when}_mm": _short(1e3 * step.held_out_rms)}
    stated = None if step.held_out is None else step.held_out.deployed
    return shown if stated is None else shown | {f"stated_{when}_mm": _short(1e3 * stated.now.rms)}


def steps_of(found: AutoRun) -> list[Record]:
    """Each step with its claim, all that it may stand for, and its estimates with how many times typical they are."""
    claims = [one.kind for one in found.attributions]
    return [
        {"added": step.added, "claim": claim, "names": [*step.names], "estimates": _estimates(step, found.model)}
        for step, claim in zip(found.steps[1:], claims, strict=True)
    ]


def _estimates(step: Step, model: Model) -> dict[str, list[float]]:
    """By key: the value in the key's unit, and over the typical size; of the last model."""
    keys = [key for key in model.keys if effect_of(key) == step.added and key in model.free]
    values = {key: (model.value(key), model.parameter(key)) for key in keys}
    return {
        key: [_short(value / parameter.si), _short(value / parameter.typical)]
        for key, (value, parameter) in values.items()
    }


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def ratio(record: Record) -> float | None:
    """Error after `auto` over that before; infinite where the model after has no equilibrium and that before has."""
    if "after_mm" not in record:
        return None
    if record.get("after_unsettled", 0) > record.get("before_unsettled", 0):
        return float("inf")
    return float(record["after_mm"] / record["before_mm"])


def stated_off(record: Record) -> float | None:
    """Error that the tool states as deployed over that at fresh poses, with noise, less one; None: it states none."""
    if "stated_after_mm" not in record or "after_mm" not in record:
        return None
    return float(record["stated_after_mm"] / np.hypot(record["after_mm"], NOISE_MM)) - 1.0


def ratio_with_noise(record: Record) -> float | None:
    """The same of errors as a measurement with its noise would show them."""
    if "after_mm" not in record:
        return None
    after, before = (np.hypot(record[f"{when}_mm"], NOISE_MM) for when in ("after", "before"))
    return float(after / before)
