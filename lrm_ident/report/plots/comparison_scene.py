"""A comparison as an MCAP file of Foxglove's scenes: one message for each pose.

Topics: `/arm`, the line through the joints to the tip; `/errors/0_nominal`, an arrow at the tip, the error of the arm
as drawn as `position_error` signs it; and one for the model after each step of its history, such as `/errors/1_fit` and
`/errors/2_add_backlash@joint2`. Pose number k stands at k seconds. Arrows are as long as the errors, times `ENLARGED`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from lrm_ident.data.registration.set_up import nominal_arm
from lrm_ident.report.plots.foxglove import JsonMessage, Rgb, color, line, mcap_file, pose, scene_message
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_math.arrays import Array
from lrm_math.kinematics.forward import frames
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

ENLARGED = 20.0
GREY, RED, BLUE = (0.5, 0.5, 0.5), (0.9, 0.2, 0.1), (0.1, 0.3, 0.9)
SECOND = 1_000_000_000


def scene_file(comparison: ModelComparison, models: Sequence[tuple[str, Model]]) -> bytes:
    """Content of the file; `models`: after each step, by its name. Raises `LrmError`: mcap is not installed."""
    return mcap_file(_scenes(comparison, models), "lrm-ident")


def _scenes(comparison: ModelComparison, models: Sequence[tuple[str, Model]]) -> Iterator[JsonMessage]:
    data, equilibrium = comparison.data, comparison.equilibrium
    steps = [("nominal", nominal_arm(equilibrium.model.arm, data)), *models]
    errors = {
        topic_of(k, name): (name, data.position_error(solve_equilibrium(model, data.poses)))
        for k, (name, model) in enumerate(steps)
    }
    lines = frames(equilibrium.model.chain, equilibrium.slots, len(data.poses))[:, :, :3, 3]
    for k, number in enumerate(data.pose.tolist()):
        t = int(number) * SECOND
        yield scene_message("/arm", t, _about("arm", int(number)), {"lines": [line(lines[k], GREY)]})
        for place, (topic, (name, error)) in enumerate(errors.items()):
            arrow = _arrow(lines[k, -1], error[k], _between(place / max(len(errors) - 1, 1)))
            yield scene_message(topic, t, _about(name, int(number)), {"arrows": [arrow]})


def topic_of(number: int, step: str) -> str:
    """Topic of the errors after a step: its number, 0 for the arm as drawn, and its name."""
    return f"/errors/{number}_{re.sub(r'[^A-Za-z0-9@<+.-]+', '_', step)}"


def _between(share: float) -> Rgb:
    """A colour from red to blue."""
    red, green, blue = ((1.0 - share) * a + share * b for a, b in zip(RED, BLUE, strict=True))
    return red, green, blue


def _about(step: str, pose_number: int) -> dict[str, str]:
    return {"step": step, "pose": str(pose_number), "arrows_enlarged": f"{ENLARGED:g}"}


def _arrow(tail: Array, error: Array, rgb: Rgb) -> dict[str, Any]:
    """An arrow along an error (3,), m, from a place."""
    length = ENLARGED * float(np.linalg.norm(error))
    shape = {"shaft_length": 0.8 * length, "shaft_diameter": 0.004, "head_length": 0.2 * length, "head_diameter": 0.01}
    return {"pose": pose(tail, error), **shape, "color": color(rgb)}
