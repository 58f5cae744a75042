"""What a fit's model has to state before it drives an arm, after whatever fitted it."""

from __future__ import annotations

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.deployment.carried_states import with_carried_states
from lrm_ident.residual.deployment.reverting_terms import with_reverting_terms
from lrm_ident.residual.deployment.unmeasured_angles import with_unmeasured_angles


def deployable(fitted: Fit, data: Measurements) -> Fit:
    """The fit, whose model states what outlasts its session, and how far it holds beyond its poses.

    The states are chosen first, by predicting later poses: a term that ended at the range of the earlier ones would
    count there.
    """
    return with_reverting_terms(with_unmeasured_angles(with_carried_states(fitted, data)), data)
