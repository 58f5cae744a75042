"""A fleet's prior on arms without hidden effects: `python -m validation.fleet.fits_only --own 0.03`.

No effect is searched, so what is seen is the prior on the parameters alone, in seconds per arm. Printed beside what the
true population would give at best (`expected_errors`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.checked import load_checked
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_ident.fitting.priors import PriorFile, to_prior
from lrm_ident.fleet.fleet_prior import arm_estimates, fleet_knowledge, prior_file
from lrm_ident.fleet.identify_arm import ArmRecord, evidence_of
from lrm_math.arm.arm_file import load_arm
from validation.fleet.expected_errors import expected_errors
from validation.fleet.held_out_arm import ARM, tip_error
from validation.fleet.simulated_fleet import ArmOfKind, simulated_fleet
from validation.options import asked

FEW, MANY = 60, 150


def main() -> None:
    """Prints the comparison."""
    options = asked(
        __doc__,
        arms=(18, "arms in all; two thirds are the fleet"),
        seed=1,
        own=(1.0, "factor of the errors that differ from arm to arm"),
    )
    arms = simulated_fleet(options.arms, options.seed, options.own, ())
    count = round(options.arms * 2 / 3)
    best = expected_errors(arms[0], FEW, MANY, options.own, ())
    with TemporaryDirectory(prefix="fits-only-") as scratch:
        prior = _prior(arms[:count], Path(scratch))
        errors = np.array([list(_tips(arm, prior, Path(scratch))) for arm in arms[count:]])
    print(f"errors of arms x {options.own}, {count} sisters, {len(errors)} held out; RMS error of the tip, mm")
    rows = zip(("60 poses, with the prior", "60 poses", "150 poses"), np.median(errors, axis=0), best, strict=True)
    for name, measured, expected in rows:
        print(f"  {name:26s} median {measured:.3f}, expected {expected:.3f}")


def _data(arm: ArmOfKind, poses: int, folder: Path) -> Measurements:
    return load_checked(arm.write_data(folder, poses), load_arm(ARM))


def _prior(sisters: Sequence[ArmOfKind], folder: Path) -> PriorFile:
    """The prior that arms make of which nothing but offsets and compliances is known, as `lrm-ident fleet` makes it."""
    described = load_arm(ARM)
    start = nominal_model(described)
    estimates = [
        arm_estimates(arm.name, evidence_of(start, _data(arm, FEW, folder), ARM), described) for arm in sisters
    ]
    records = [ArmRecord(name=arm.name, sha256="made") for arm in sisters]
    return prior_file(fleet_knowledge(records, estimates), "simulated fleet", "validation.fleet.fits_only")


def _tips(arm: ArmOfKind, prior: PriorFile, folder: Path) -> Iterator[float]:
    """Error of the tip (mm) from few poses with the prior, few without, many without."""
    for poses, known in ((FEW, prior), (FEW, None), (MANY, None)):
        start = nominal_model(load_arm(ARM))
        given = None if known is None else to_prior(Path("fleet"), known, start)
        fitted = fit_model(start, _data(arm, poses, folder), "identifiable", SQUARED, prior=given).fit
        yield tip_error(arm, fitted.model)


if __name__ == "__main__":
    main()
