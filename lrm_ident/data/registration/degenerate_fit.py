"""Whether a fit explains measurements by destroying the arm: shrunk, stretched, or without one of its lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from lrm_ident.data.registration.point_set import nominal_tcp
from lrm_ident.data.registration.row_choice import spaced_rows
from lrm_ident.data.registration.similarity import robust_similarity
from lrm_ident.data.wording import in_mm, in_percent
from lrm_math.arm.plausible_arm import reach
from lrm_math.effects import ParameterRef
from lrm_math.errors import LrmError
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model

LEAST_SCALE, MOST_SCALE = 0.7, 1.4
LONG, LEFT = 0.1, 0.3
"""Share of the reach of a length that is looked at, and share of it that must be left."""
OWN, LOOKED_AT = 0.1, 200
"""Motion that the TCP must make for a length beyond what other parameters can undo (m/m), seen at so many poses."""
CHECK = "are unit, axes and frame right, and is it this arm?"


class DegenerateFit(LrmError):
    """A fit that lowers the error only by destroying the arm."""


def check_arm(settled: Equilibrium, free: Sequence[str]) -> None:
    """Raises `DegenerateFit` if a fit does not describe the arm of the question.

    Args:
        settled: equilibrium of the fitted model at the poses.
        free: keys of the fitted parameters.
    """
    model = settled.model
    nominal = nominal_tcp(model.arm, settled.poses)
    if len(nominal) > len(free) and np.ptp(nominal, axis=0).max() > 0:
        scale = robust_similarity(nominal, settled.tcp, mirrored=False).scale
        if not LEAST_SCALE < scale < MOST_SCALE:
            verb = "shrinks" if scale < 1 else "stretches"
            raise DegenerateFit(f"the fit lowers the error only as it {verb} the arm to {in_percent(scale)} %; {CHECK}")
    for key, drawn, fitted in lengths(model, free):
        if abs(drawn) > LONG * reach(model.arm) and fitted / drawn < LEFT and _own_motion(settled, free, key) > OWN:
            change = f"from {in_mm(drawn)} to {in_mm(fitted)} mm"
            raise DegenerateFit(f"the fit lets a length collapse: {key} goes {change}; {CHECK}")


def _own_motion(settled: Equilibrium, free: Sequence[str], key: str) -> float:
    """RMS motion of the TCP for a unit of one length, without what the other fitted parameters can undo (m/m).

    The first joint's offset along its own axis, say, is nearly a shift of the base: what it takes while an effect is
    missing means nothing by itself, however small its standard error.
    """
    rows = spaced_rows(len(settled.poses), LOOKED_AT)
    J = parameter_jacobian(settled.take(rows), free).reshape(3 * len(rows), len(free))
    column, others = J[:, free.index(key)], np.delete(J, free.index(key), axis=1)
    scaled = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    unexplained = column - scaled @ np.linalg.lstsq(scaled, column, rcond=None)[0]
    return float(np.linalg.norm(unexplained) / np.sqrt(len(rows)))


def lengths(model: Model, free: Sequence[str]) -> list[tuple[str, float, float]]:
    """Every fitted length of the links and the tool: its key, as drawn, and as fitted (m)."""
    arm, lengths_found = model.arm, []
    places = {**{name: asdict(joint) for name, joint in zip(arm.link_places, arm.links, strict=True)}}
    places["tool"] = asdict(arm.tool)
    for key in free:
        effect, place, name = ParameterRef.parse(key)
        if effect == "offsets" and place in places and name.endswith("_mm"):
            drawn = places[place].get(name.removesuffix("_mm")) or 0.0
            lengths_found.append((key, drawn, drawn + model.value(key)))
    return lengths_found
