"""The command within the limits whose tool is nearest to a goal: least squares of distance and rotation."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lrm_math.errors import LrmError
from lrm_math.ik.answer import Nearest
from lrm_math.ik.calibrated_arm import CalibratedArm
from lrm_math.ik.kernel.kernel_model import matrices
from lrm_math.ik.solutions import IkQuery


@lru_cache(maxsize=4)
def nearest(arm: CalibratedArm, query: IkQuery, starts: tuple[tuple[float, ...], ...] = ()) -> Nearest:
    """Least squares of distance (m) and scaled rotation over the commands within the limits.

    `starts`: commands (rad) to start from, beside the closest poses of the library. Of effects that the kernel does not
    know, the linear part decides about the command; its distance is that of the whole model.

    Raises `LrmError`: the arm does not settle anywhere near.
    """
    found = arm.kernel(query.payload).nearest(query.goal, starts)
    if found is not None:
        settled = arm.equilibria(query, np.array([found[0]]))
        if len(settled.rows):
            return Nearest.at(found[0], query.goal, matrices(settled.tcp)[0])
    raise LrmError("the arm comes to rest in no pose near this goal; its compliances may be wrong")
