"""Photos of a board that is another one than was stated, and what `camera calibrate` makes of them."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from lrm_ident.measuring.camera.board import DICTIONARIES, CharucoBoard
from lrm_ident.measuring.camera.opencv import opencv
from validation.camera.rendered_photos import PhotoScene
from validation.newcomer_files.outcome import HEALTHY, ChangeOutcome, outcome_of, said_by

COLUMNS, ROWS = 6, 4


def board(rng: np.random.Generator) -> ChangeOutcome:
    """A photo of a board of another pattern, dictionary or size; it must be named, with the option that reads it."""
    kind = str(rng.choice(["legacy", "dictionary", "turned"]))
    others = [name for name in DICTIONARIES if name != CharucoBoard().dictionary]
    other = others[int(rng.integers(len(others)))]
    shown = {
        "legacy": CharucoBoard(columns=COLUMNS, rows=ROWS, legacy=True),
        "dictionary": CharucoBoard(columns=COLUMNS, rows=ROWS, dictionary=other),
        "turned": CharucoBoard(columns=ROWS, rows=COLUMNS),
    }[kind]
    words = {
        "legacy": "--legacy",
        "dictionary": f"--dictionary {other.partition('_')[0]}",
        "turned": f"--columns {ROWS}",
    }[kind]
    pose = np.eye(4)
    pose[:3, :3] = opencv().Rodrigues(rng.uniform(-0.3, 0.3, 3))[0]
    pose[:3, 3] = -0.045 + rng.uniform(-0.005, 0.005), -0.035, rng.uniform(0.16, 0.2)
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "photos").mkdir()
        opencv().imwrite(f"{scratch}/photos/p.png", PhotoScene().photo(shown, pose, int(rng.integers(1000))))
        stated = ("--columns", COLUMNS, "--rows", ROWS, "-o", f"{scratch}/lens.toml")
        code, said = said_by("camera", "calibrate", f"{scratch}/photos", *stated)
    read = "1 usable photos" in said  # a dictionary of which the stated one is the beginning
    outcome = HEALTHY if read else outcome_of(code, words in said, wrong=True)
    return ChangeOutcome("board", "board", f"{kind} {other}", outcome, said[:300])
