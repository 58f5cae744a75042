"""Held-out error on public measurements of real arms, ours beside rigid least squares, a Gaussian process and boosting.

    python -m validation.real_data [--mirror FOLDER] [--poses N]

All on the same folds of joint space. Without a network the data sets are skipped, and the reason is printed.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import lrm_ident as lrm
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.cross_validation import joint_space_folds
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import solve_equilibrium
from validation.real_data.rivals import boosting, gaussian_process
from validation.real_data.sources import SOURCES, NotReachable, Source

RIGID, OURS = "rigid least squares", "lrm-ident fit (offsets, compliances)"
BLACK_BOXES: dict[str, Callable[[Array, Array, Array], Array]] = {
    "rigid, and a Gaussian process": gaussian_process,
    "rigid, and gradient boosting": boosting,
}


def main(words: list[str] | None = None) -> None:
    """Prints one table for each data set that can be had."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mirror", type=Path, help="folder with OWNER/NAME/PATH of the files, in place of the network")
    parser.add_argument("--poses", type=int, help="at most so many poses, drawn at random, always the same")
    options = parser.parse_args(words)
    for source in SOURCES:
        print(f"{source.repository} {source.path}, {source.licence}, {source.author}")
        try:
            text = source.text(options.mirror)
        except NotReachable as why:
            print(f"  skipped: {why}; give --mirror FOLDER where there is no network")
            continue
        for name, rms in held_out(measured(source, text, options.poses)).items():
            print(f"  {name:40} {1e3 * rms:7.3f} mm RMS held out")


def measured(source: Source, text: str, most: int | None) -> Measurements:
    """The measurements in a file's text, at most so many of them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.csv"
        path.write_text(source.measurements(text), encoding="utf-8")
        data = lrm.load(path, arm=source.arm)
    rows = np.random.default_rng(1).permutation(len(data))[: most or len(data)]
    return data.take(np.sort(rows))


def held_out(data: Measurements) -> dict[str, float]:
    """Held-out RMS distance (m) of every method, over the same folds."""
    left = {name: np.empty_like(data.tcp) for name in ("as drawn", RIGID, *BLACK_BOXES, OURS)}
    for known, unseen, rows in parts(data):
        nominal = lrm.Study.of(data, "offsets").model
        left["as drawn"][rows] = unseen.tcp - solve_equilibrium(nominal, unseen.poses).tcp
        rigid = lrm.Study.of(known, "offsets").fit().model
        left[RIGID][rows] = unseen.tcp - solve_equilibrium(rigid, unseen.poses).tcp
        rest = known.tcp - solve_equilibrium(rigid, known.poses).tcp
        for name, learn in BLACK_BOXES.items():
            left[name][rows] = left[RIGID][rows] - learn(known.poses.q, rest, unseen.poses.q)
        ours = lrm.Study.of(known).fit().model
        left[OURS][rows] = unseen.tcp - solve_equilibrium(ours, unseen.poses).tcp
    return {name: float(np.sqrt((error**2).sum(axis=1).mean())) for name, error in left.items()}


def parts(data: Measurements) -> Iterator[tuple[Measurements, Measurements, Array]]:
    """Measurements that are known and that are predicted, for each fold of joint space, and the latter's rows (N,)."""
    fold = joint_space_folds(data.poses.q, data.repeat_of)
    for number in range(int(fold.max()) + 1):
        yield data.take(fold != number), data.take(fold == number), fold == number


if __name__ == "__main__":
    main()
