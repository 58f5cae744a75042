"""Held-out error of a model as it is deployed, beside that in the session of its measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.fitting.held_out import HeldOutBlock, deployed_residual, time_unknown_residual
from lrm_ident.residual.deployment.carried_states import rows_as_deployed
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import Model
from lrm_math.model.session_state import StateAfterSession


@dataclass(frozen=True)
class DeployedError:
    """Held-out error of a model `as_deployed`.

    Attributes:
        now: at the poses where the state that is deployed held (`rows_as_deployed`).
        otherwise: at the others, such as of a colder arm; None where the state held at all.
        time_unknown: where neither the time since power-on is known nor what the arm did before; None: nothing of the
            model follows them.
        state: what the deployed model keeps of its session; None: nothing.
    """

    now: ErrorStats
    otherwise: ErrorStats | None = None
    time_unknown: ErrorStats | None = None
    state: StateAfterSession | None = None

    @classmethod
    def of(cls, model: Model, poses: Poses, blocks: Sequence[HeldOutBlock]) -> DeployedError:
        """The error of a model that was cross-validated at these poses."""
        error = cls.of_residual(deployed_residual(blocks), rows_as_deployed(model, poses))
        unknown = time_unknown_residual(blocks)
        return replace(error, state=model.state, time_unknown=None if unknown is None else error_stats(unknown))

    @classmethod
    def of_residual(cls, residual: Array, rows: NDArray[np.int64]) -> DeployedError:
        """The error of a residual (N, 3) in m, of which at some rows the deployed state held."""
        others = np.delete(residual, rows, axis=0)
        return cls(error_stats(residual[rows]), error_stats(others) if len(others) else None)

    def as_json(self) -> dict[str, object]:
        """The table `as_deployed`."""
        more = {"otherwise": self.otherwise, "time_unknown": self.time_unknown}
        return {**self.now.as_json(), **{name: one.as_json() for name, one in more.items() if one is not None}}
