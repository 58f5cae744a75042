"""Calibration by sockets on a simulated SO-101: `python -m examples.so101.sockets_demo [--seed N] [--out FOLDER]`.

An arm is drawn by the seed, with errors of its geometry, springs and play. Its tip is jogged into the sockets of a
printed board, 20 touches at three placements; the touches are fitted and diagnosed by the real commands. At the end the
tip's error at 100 fresh poses stands beside that of the same poses measured by a tracker.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from examples.demo.options import run_in_folder
from examples.so101.touched_sockets import ARM, DEG, NOISE_M, loaded, of_generator, tip_error_mm, touched
from lrm_ident.cli.app import app
from lrm_ident.cli.common import show
from lrm_ident.measuring.sockets.board import SocketBoard
from lrm_ident.report.document import heading
from lrm_ident.study import inputs
from lrm_ident.study.study import Study
from lrm_math.model.model import model_of
from validation.synthetic import SoftPlay

TOUCHES = 24
"""Planned; a socket or two is out of reach of most arms, and the diagnosis asks for 20 touches."""


def run_demo(folder: Path, seed: int) -> None:
    """Runs all steps and prints the errors at the end. Raises `LrmError`."""
    show(heading(f"Seed {seed}: `make demo ARM=so101 BY=sockets SEED={seed}` runs the same demo again."))
    tips = of_generator(SoftPlay(3, 1.0 * DEG, 0.05))(seed)
    run("sockets", "board", "-o", folder / "sockets.stl")
    q, names, where, seen = touched(tips, seed, TOUCHES)
    done = f"{len(names)} of {TOUCHES} planned touches" + (
        ", the others are out of reach" if len(names) < TOUCHES else ""
    )
    show(heading(f"{done}; three placements (simulated: the arm is jogged until its tip is in a socket)"))
    loaded(folder, q, {"point": names, "placement": [f"p{k}" for k in where]}, SocketBoard().metadata("so101"))
    data, model = folder / "data.csv", folder / "model.toml"
    run("fit", data, "-o", model)
    run("diagnose", model, data)
    by_sockets = inputs.read_study(model, data)
    rng = np.random.default_rng([seed, 70])
    measured = seen + rng.normal(0.0, NOISE_M, seen.shape)
    columns = {f"{axis}_mm": [f"{1e3 * value:.4f}" for value in measured[:, k]] for k, axis in enumerate("xyz")}
    with tempfile.TemporaryDirectory() as private:
        beside = 'schema = "lrm/measurements/1"\narm = "so101"\n'
        by_tracker = Study.of(loaded(Path(private), q, columns, beside)).fit()
    drawn = Study(model_of(ARM, ()), by_sockets.data, "so101")
    show(heading("Error of the tip at 100 fresh poses, up to a rigid motion (RMS)"))
    for words, study in (("arm as drawn", drawn), ("by sockets", by_sockets), ("by a tracker", by_tracker)):
        show(f"  {words:13} {tip_error_mm(study, tips, seed):6.2f} mm")


def run(*words: object) -> None:
    """Runs a command as a person would type it."""
    show(heading(f"$ lrm-ident {' '.join(map(str, words))}"))
    if app([str(word) for word in words], standalone_mode=False):
        raise KeyboardInterrupt


def main(argv: list[str] | None = None) -> int:
    """Runs the demo. Exit code 0, or 2 with one line that says what failed."""
    return run_in_folder("examples.so101.sockets_demo", __doc__ or "", run_demo, argv)


if __name__ == "__main__":
    sys.exit(main())
