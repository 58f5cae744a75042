"""Poses that identify the installation of a calibrated arm, and the error of the tip that is expected with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lrm_ident.design.candidate_poses import ClearanceRules, clear_poses, parse_levels
from lrm_ident.design.pose_design import DesignProblem, design
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.fitting.transfer import TransferredModel
from lrm_math.kinematics.poses import Poses
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.uncertainty import expected_tip_error

FEW = 6
"""Poses that are chosen where no number is given."""
COUNTS = (3, FEW, 12)
LEVELS = "4"


def installation_poses(start: TransferredModel, count: int, candidates: Poses | None = None) -> Poses:
    """The poses that tell most of an installation, with the arm's part known as by its prior.

    Raises `LrmError`: no pose keeps the clearance rules.
    """
    offer = _clear(start) if candidates is None else candidates
    task = DesignProblem(
        model=start.model,
        keys=start.covariance.keys,
        rivals=(),
        count=count,
        index="O1",
        noise=start.noise,
        measured=None,
        repeats=0,
        first_number=1,
        seed=0,
        prior=start.covariance,
    )
    return design(task, offer).poses


def expected_errors(
    start: TransferredModel, counts: Sequence[int] = COUNTS, progress: OnProgress = silent
) -> Mapping[int, float]:
    """RMS error of the tip (m) that is expected without any pose, and with so many of `installation_poses`."""
    offer, expected = _clear(start), {0: expected_tip_error(start.model, start.covariance)}
    for done, count in enumerate(counts):
        progress(done, len(counts))
        settled = solve_equilibrium(start.model, installation_poses(start, count, offer))
        after = start.informed(parameter_jacobian(settled, start.covariance.keys))
        expected[count] = expected_tip_error(start.model, after)
    return expected


def _clear(start: TransferredModel) -> Poses:
    arm = start.measured_arm
    return clear_poses(arm, parse_levels(arm, LEVELS), (0.0,), ClearanceRules(), 0).poses
