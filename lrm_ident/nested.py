"""Held-out error of `auto` itself: the effects are chosen anew in every fold, in parallel processes."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrm_ident.catalogue import Catalogue
from lrm_ident.compare import HeldOut
from lrm_ident.dataset import Measurements
from lrm_ident.folds import blocks
from lrm_ident.progress import Tick, silent
from lrm_ident.steps import follow_advice
from lrm_math.effects import CATALOGUE
from lrm_math.equilibrium import equilibrium
from lrm_math.errors import LrmError
from lrm_math.model import Model

Array = NDArray[np.float64]


def nested_held_out(
    model: Model,
    data: Measurements,
    most: int = 20,
    catalogue: Catalogue = CATALOGUE,
    effects_file: Path | None = None,
    progress: Tick = silent,
) -> Array:
    """(N, 3): residual (m) of each joint-space block, predicted by an `auto` that chose its effects without it.

    Args:
        effects_file: where user's effects of the catalogue come from; without one, folds share the work of all cores.
    """
    fold = blocks(data.poses.q, data.repeat_of)
    residual = np.empty_like(data.tcp)
    parts = [fold == number for number in range(int(fold.max()) + 1)]
    if effects_file is not None:
        for done, out in enumerate(parts, start=1):
            residual[out] = _predict(model, data, out, most, catalogue)
            progress(done, len(parts))
        return residual
    workers = min(len(parts), os.cpu_count() or 1)
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(_predict, model, data, out, most, catalogue): out for out in parts}
        for done, future in enumerate(as_completed(waiting), start=1):
            residual[waiting[future]] = future.result()
            progress(done, len(parts))
    return residual


def try_nested(
    model: Model,
    data: Measurements,
    most: int = 20,
    catalogue: Catalogue = CATALOGUE,
    effects_file: Path | None = None,
    progress: Tick = silent,
) -> HeldOut:
    """The same, or why it cannot be had (a fold that does not converge, or whose model does not settle)."""
    try:
        return HeldOut(nested_held_out(model, data, most, catalogue, effects_file, progress))
    except LrmError as error:
        return HeldOut(None, str(error))


def _predict(model: Model, data: Measurements, out: NDArray[np.bool_], most: int, catalogue: Catalogue) -> Array:
    chosen = follow_advice(model, data.take(~out), most, catalogue).model
    return np.asarray(data.tcp[out] - equilibrium(chosen, data.poses.take(out)).tcp)
