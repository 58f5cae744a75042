"""One simulated arm identified with or without a fleet's prior, against its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.registration.checked import load_checked
from lrm_ident.diagnosis.auto import AutoRun, run_auto
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS, fit_model, nominal_model
from lrm_ident.fitting.priors import EffectRates, PriorFile, to_prior
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects.reference import EffectRef
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from validation.fleet.simulated_fleet import ArmOfKind

ARM = "lrm-lab"


@dataclass(frozen=True)
class HeldOutArm:
    """One arm that the fleet has not seen, identified in one way.

    tip_mm: RMS error of the tip at goals. false_names, missed: effects named that it has not, and those not named.
    """

    name: str
    tip_mm: float
    false_names: tuple[str, ...]
    missed: tuple[str, ...]


def identify(arm: ArmOfKind, poses: int, prior: PriorFile | None) -> HeldOutArm:
    """One arm measured at so many poses and identified, as `fit` and `auto` with or without `--prior`."""
    described = load_arm(ARM)
    with TemporaryDirectory(prefix="fleet-arm-") as scratch:
        data = load_checked(arm.write_data(Path(scratch), poses), described)
        rates = None
        if prior is not None:
            rates = EffectRates({name: one.rate for name, one in prior.effects.items()}, prior.other_rate or 0.01)
        first = fit_model(nominal_model(described), data, "identifiable", SQUARED).fit
        run = run_auto(first.model, data, rates=rates)
    model = run.model
    if prior is not None:
        known = to_prior(Path("fleet"), prior, model)
        model = fit_model(model, run.steps[-1].data, "identifiable", SQUARED, prior=known).fit.model
    named = _named(run)
    false = tuple(step[0] for step in named if not set(step) & set(arm.names))
    missed = tuple(name for name in arm.names if not any(name in step for step in named))
    return HeldOutArm(arm.name, tip_error(arm, model), false, missed)


def tip_error(arm: ArmOfKind, model: Model) -> float:
    """RMS distance (mm) of the model's tip from the true one, at goals that were not measured; the first pose, before
    which no direction is known, left out."""
    poses, truth = arm.goals()
    return 1e3 * error_stats((solve_equilibrium(model, poses).tcp - truth)[1:]).rms


def _named(run: AutoRun) -> list[tuple[str, ...]]:
    """The names of each step that is not a form of what every arm has."""
    return [step.names for step in run.steps[1:] if EffectRef.parse(step.names[0]).id not in DEFAULT_EFFECTS]
