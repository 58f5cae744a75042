"""Held-out error of `auto` itself: the effects are chosen anew in every fold, in parallel processes."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from itertools import starmap
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import follow_advice
from lrm_ident.effect_plugins import Catalogue
from lrm_ident.fit.cross_validation import blocks
from lrm_ident.fit.error_breakdown import HeldOut
from lrm_ident.progress import Tick, silent
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model


def nested_held_out(
    model: Model,
    data: Measurements,
    most: int = 20,
    catalogue: Catalogue = CATALOGUE,
    effects_file: Path | None = None,
    progress: Tick = silent,
) -> HeldOut:
    """Each joint-space block predicted by an `auto` that chose its effects without it.

    There is none, with the reason, if a fold does not converge or its model does not settle at a held-out pose.

    Args:
        effects_file: where user's effects of the catalogue come from. Classes of such a file cannot travel to other
            processes, so then the folds run one after the other.
    """
    fold = blocks(data.poses.q, data.repeat_of)
    parts = [fold == number for number in range(int(fold.max()) + 1)]
    jobs = [(model, data, out, most, catalogue) for out in parts]
    residual = np.empty_like(data.tcp)
    try:
        with _workers(0 if effects_file else len(parts)) as run:
            for done, (out, left) in enumerate(zip(parts, run(_predict, jobs), strict=True), start=1):
                residual[out] = left
                progress(done, len(parts))
    except LrmError as error:
        return HeldOut(None, str(error))
    return HeldOut(residual)


@contextmanager
def _workers(most: int) -> Iterator[Callable[..., Iterable[Array]]]:
    """Something that runs a function on many argument tuples, in order: in up to `most` processes, or here if 0."""
    if most == 0:
        yield starmap
        return
    with ProcessPoolExecutor(min(most, os.cpu_count() or 1), multiprocessing.get_context("spawn")) as pool:
        yield lambda function, jobs: pool.map(function, *zip(*jobs, strict=True))


def _predict(model: Model, data: Measurements, out: NDArray[np.bool_], most: int, catalogue: Catalogue) -> Array:
    chosen = follow_advice(model, data.take(~out), most, catalogue).model
    return np.asarray(data.tcp[out] - equilibrium(chosen, data.poses.take(out)).tcp)
