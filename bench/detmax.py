"""Choosing 50 of 393 poses for 28 parameters: how long it takes, and how near to the best possible it comes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lrm_ident.design.detmax import best_possible_o1, exchange
from lrm_ident.design.observability import Index, identification_jacobian, observability
from lrm_ident.fit.parameter_sets import TABLE_4_5
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of

CHOSEN = 50


@dataclass(frozen=True, eq=False)
class Search:
    """The candidates' columns (N, 3, 28), the search, and one exchange of a search that decomposes anew each time."""

    columns: np.ndarray
    ours: Callable[[], object]
    one_exchange_decomposed: Callable[[], object]


def search_on(poses: Poses, index: Index = "O1") -> Search:
    """The search among poses of the lab arm, from several random starts."""
    arm = load_arm("lrm-lab")
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    J = identification_jacobian(equilibrium(model, poses), TABLE_4_5)
    return Search(J, lambda: exchange(J, CHOSEN, index), lambda: decomposed_exchange(J))


def decomposed_exchange(J: np.ndarray) -> tuple[int, int]:
    """The pose that a full decomposition of every trial set says to add to the first 50, and then to drop."""
    inside, outside = list(range(CHOSEN)), list(range(CHOSEN, len(J)))
    added = max(outside, key=lambda i: observability(J[[*inside, i]]).O1)
    inside.append(added)
    return added, max(inside, key=lambda i: observability(J[[k for k in inside if k != i]]).O1)


def share_of_best_possible(search: Search) -> float:
    """O1 of what the search finds over the value that no choice of as many poses exceeds."""
    rows = exchange(search.columns, CHOSEN).rows
    return observability(search.columns[rows]).O1 / best_possible_o1(search.columns, rows)
