"""`lrm-ident import lerobot`: the rests of a LeRobot dataset as poses with joint feedback."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.cli.common import show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.write import metadata_toml
from lrm_ident.measuring.recordings.lerobot import read_lerobot, rests_csv
from lrm_math.arm.arm_file import arm_name_for, load_arm

LEROBOT = "lerobot"
SO101 = "so101"


def import_lerobot(dataset: Path, output: Path, arm: str | None, dwell: float) -> None:
    """Writes the rests of a dataset as poses, and a .toml file beside them. Raises `LrmError`."""
    name = arm or SO101
    rests = read_lerobot(dataset, load_arm(name), dwell)
    sd, source = round(float(np.degrees(rests.feedback_sd)), 5), f"LeRobot dataset {dataset.name}"
    metadata = metadata_toml(arm_name_for(name, output.parent), source, feedback_sd_deg=sd)
    write_text(output, rests_csv(rests))
    write_text(output.with_suffix(".toml"), metadata)
    off = np.degrees(rests.feedback - rests.command)
    worst = int(np.abs(off).mean(axis=0).argmax())
    show(
        f"{len(rests.t)} rests of {len(np.unique(rests.episode))} episodes written to {output}.",
        f"Joint {worst + 1}'s servo is off its command most: by {np.abs(off[:, worst]).mean():.2f} deg on average.",
    )
