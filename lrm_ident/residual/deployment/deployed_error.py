"""Held-out error of a model as it is deployed, beside that in the session of its measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.fitting.held_out import HeldOutBlock, deployed_residual, time_unknown_residual
from lrm_ident.residual.deployment.carried_states import rows_as_deployed
from lrm_ident.residual.deployment.forecast_error import ForecastError
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import Model
from lrm_math.model.session_state import StateAfterSession

NO_RESIDUAL: Array = np.empty((0, 3))


@dataclass(frozen=True)
class DeployedError:
    """Held-out error of a model `as_deployed`.

    Attributes:
        now: at the poses where the state that is deployed held (`rows_as_deployed`).
        otherwise: at the others, such as of a colder arm; None where the state held at all.
        time_unknown: where neither the time since power-on is known nor what the arm did before; None: nothing of the
            model follows them.
        state: what the deployed model keeps of its session; None: nothing.
        fewer: number of poses that `now` is of, where those are not all; None: all.
        among_measured: where the arm goes on changing (`forecast_error`): as `now` was by a cross-validation, which
            interpolates in time. `now` is of later poses then.
    """

    now: ErrorStats
    otherwise: ErrorStats | None = None
    time_unknown: ErrorStats | None = None
    state: StateAfterSession | None = None
    fewer: int | None = None
    among_measured: ErrorStats | None = None

    @classmethod
    def of(
        cls, model: Model, poses: Poses, blocks: Sequence[HeldOutBlock], later: ForecastError,
        left_out: Array = NO_RESIDUAL,
    ) -> DeployedError:  # fmt: skip
        """The error of a model that was cross-validated at these poses.

        Args:
            later: error of later poses, where it is worse than of those among the measured ones: it counts then.
            left_out: (M, 3), m, residual at poses that its fits left out although the arm errs there: it counts.
        """
        rows = rows_as_deployed(model, poses)
        kept = deployed_residual(blocks)
        error = cls.of_residual(np.concatenate([kept, left_out]), np.append(rows, len(kept) + np.arange(len(left_out))))
        unknown = time_unknown_residual(blocks)
        restarted = None
        if unknown is not None:
            restarted = _larger(error_stats(np.concatenate([unknown, left_out])), later.unknown)
        current = _larger(error.now, later.followed)
        among = None if current is error.now else error.now
        fewer = error.fewer if among is None else later.poses
        return replace(error, now=current, state=model.state, time_unknown=restarted, fewer=fewer, among_measured=among)

    @classmethod
    def of_residual(cls, residual: Array, rows: NDArray[np.int64]) -> DeployedError:
        """The error of a residual (N, 3) in m, of which at some rows the deployed state held."""
        others = np.delete(residual, rows, axis=0)
        if not len(others):
            return cls(error_stats(residual[rows]))
        return cls(error_stats(residual[rows]), error_stats(others), fewer=len(rows))

    def as_json(self) -> dict[str, object]:
        """The table `as_deployed`; `rms_95_mm`: the RMS at other poses like these, while the arm stays as it is."""
        more = {
            "otherwise": self.otherwise, "time_unknown": self.time_unknown, "among_measured": self.among_measured,
        }  # fmt: skip
        part: dict[str, object] = {} if self.fewer is None else {"poses": self.fewer}
        if self.now.rms_between is not None:
            part["rms_95_mm"] = [1e3 * end for end in self.now.rms_between]
        return {
            **self.now.as_json(),
            **part,
            **{name: error.as_json() for name, error in more.items() if error is not None},
        }


def _larger(error: ErrorStats, later: ErrorStats | None) -> ErrorStats:
    return error if later is None or later.rms <= error.rms else later
