"""Structure that has no name: free functions on what the named effects leave, and whose name was only borrowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.forward_selection import helps
from lrm_ident.diagnosis.free_functions import FreeFunction, product_functions, quantities, single_functions
from lrm_ident.diagnosis.linearised_fit import Bench, Prepared, paired
from lrm_ident.diagnosis.score_test import SURE, Scored
from lrm_ident.fit.levenberg_marquardt import Fit
from lrm_math.arrays import Array

MATERIAL = 0.10  # part of the held-out RMS that a free function must save to be structure without a name
MOST_FREE = 3


@dataclass(frozen=True, eq=False)
class FreeStructure:
    """What free functions say of what the path leaves."""

    functions: tuple[FreeFunction, ...]
    borrowed: dict[str, str]
    anatomy: tuple[tuple[FreeFunction, float], ...]


def free_structure(
    path: Sequence[Scored], on: Bench, turns: Array, data: Measurements, fitted: Fit, weight: Array
) -> FreeStructure:
    """Nameless functions that explain much of what the path leaves, whom of the path they replace, and the anatomy."""
    shared, own = quantities(data, fitted.rest.joint_torque)
    functions = [*single_functions(turns, shared, own), *product_functions(turns, shared, own)]
    ready = [(function, on.prepare(function.columns * weight)) for function in functions]
    tried = sorted(
        ((on.explain(*(one.prepared for one in path), prepared).rms, function) for function, prepared in ready),
        key=lambda one: one[0],
    )
    anatomy = tuple((function, rms) for rms, function in tried[:5])
    nameless = [(function, prepared) for function, prepared in ready if not function.has_a_name]
    free = _free_path([one.prepared for one in path], nameless, on)
    borrowed: dict[str, str] = {}
    if free:
        follows = {name for function, _ in free for name in function.follows}
        joints = {function.joint for function, _ in free}
        beside = [p for f, p in ready if len(f.follows) == 1 and f.joint in joints and f.follows[0] in follows]
        among = [*(prepared for _, prepared in free), *beside]
        for one in path:
            others = [other.prepared for other in path if other is not one]
            without, with_it = on.explain(*others, *among), on.explain(*others, one.prepared, *among)
            if not helps(with_it, without, on.explain()):
                borrowed[one.name] = free[0][0].name
    return FreeStructure(tuple(function for function, _ in free), borrowed, anatomy)


def _free_path(
    taken: Sequence[Prepared], nameless: Sequence[tuple[FreeFunction, Prepared]], on: Bench
) -> list[tuple[FreeFunction, Prepared]]:
    """Free functions taken one after the other as long as one is material, all at the joint of the first."""
    chosen: list[tuple[FreeFunction, Prepared]] = []
    now = on.explain(*taken)
    while len(chosen) < MOST_FREE:
        left = [one for one in nameless if not chosen or one[0].joint == chosen[0][0].joint]
        tried = [(on.explain(*taken, *(p for _, p in chosen), one[1]), one) for one in left if one not in chosen]
        then, best = min(tried, key=lambda pair: pair[0].rms)
        if then.rms > (1.0 - MATERIAL) * now.rms or paired(then.held_out, now.held_out) < SURE:
            break
        chosen.append(best)
        now = then
    return chosen
