"""Reports of the component tests: the compliance of one servo, the offsets of the tracker's targets."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.servo_stiffness import StiffnessEstimate
from lrm_ident.data.tracker_alignment import Alignment
from lrm_ident.data.wording import p_words, quantity
from lrm_ident.report.document import Block, Document, ResultTable, heading

SURE, SIGNIFICANT = 2.0, 0.01


def stiffness_document(estimate: StiffnessEstimate) -> Document:
    """Result of `lrm-ident stiffness`, schema `lrm/stiffness/1`: slope, linearity, loop, and the line for a prior file.

    A joint is softer than its servo: on the thesis's arm two to four times (Table 6.1 against Figure 5.7). So the
    prior's SD is twice the slope, however well the slope is known.
    """
    torque, secants = estimate.test.torque, estimate.secants
    rows = [
        ("slope (compliance)", quantity(estimate.slope, estimate.slope_error), "rad/Nm"),
        ("slopes between neighbouring loads", f"{min(secants):.4f} to {max(secants):.4f}", "rad/Nm"),
        ("largest departure from the line", f"{100 * estimate.departure:.1f}", "% of the deflection"),
        ("scatter of a reading", f"{np.degrees(estimate.scatter):.3f}", "deg"),
    ]
    loop = None
    if estimate.loop is not None and estimate.loop_error is not None:
        loop = {"value": estimate.loop, "se": estimate.loop_error}
        width = quantity(float(np.degrees(estimate.loop)), float(np.degrees(estimate.loop_error)))
        rows.insert(3, ("loop, unloading above loading", width, "deg"))
    title = f"{len(torque)} readings, {torque.min():.2f} to {torque.max():.2f} N·m"
    prior = f"{{ mean = {estimate.slope:.4f}, sd = {2.0 * estimate.slope:.4f} }}"
    verdict = [_linearity(estimate), _hysteresis(estimate)]
    blocks: list[Block] = [
        ResultTable(("", "value|", ""), rows, title),
        *verdict,
        heading("For a prior file, if this servo drives joint N (wide, as printed parts give way too):"),
        f'  "compliance.jointN.k_rad_per_Nm" = {prior}',
    ]
    values = {
        "readings": len(torque),
        "k_rad_per_Nm": {"value": estimate.slope, "se": estimate.slope_error},
        "secants_rad_per_Nm": secants,
        "departure_from_line": estimate.departure,
        "curvature_p_value": estimate.curvature_p,
        "loop_rad": loop,
        "scatter_rad": estimate.scatter,
        "verdict": verdict,
    }
    return Document(blocks, "lrm/stiffness/1", values)


def _linearity(estimate: StiffnessEstimate) -> str:
    if estimate.curvature_p is None:
        return "Too few readings to tell whether the spring is linear."
    if estimate.curvature_p < SIGNIFICANT:
        return (
            f"The spring is not linear (p {p_words(estimate.curvature_p)}): look for nonlinear_stiffness or backlash."
        )
    return f"Nothing shows that the spring is not linear (p {p_words(estimate.curvature_p)})."


def _hysteresis(estimate: StiffnessEstimate) -> str:
    if estimate.loop is None or estimate.loop_error is None:
        return "It was never unloaded: whether there is play or friction cannot be told."
    if estimate.loop < SURE * estimate.loop_error:
        return f"No loop wider than {np.degrees(estimate.loop + SURE * estimate.loop_error):.2f} deg."
    return "It does not come back the way it went: play or friction; look for backlash and hysteresis."


def alignment_document(alignment: Alignment) -> Document:
    """Result of `lrm-ident align`, schema `lrm/alignment/1`: the targets' offset, axis by axis."""
    deviation, error, noise = (1e3 * values for values in (alignment.deviation, alignment.error, alignment.noise))
    columns = ("axis", "deviation mm|.3f", "± standard error|", "noise mm|.3f")
    rows = [("xyz"[i], deviation[i], f"± {error[i]:.3f}", noise[i]) for i in range(3)]
    sd = np.sqrt(np.mean(alignment.noise**2)) * 1e3
    blocks: list[Block] = [
        ResultTable(columns, rows, f"{alignment.readings} readings of the fixture"),
        f"For the file beside the measurements: noise_sd_mm = {sd:.3f}",
    ]
    values = {
        "readings": alignment.readings,
        "deviation_mm": deviation,
        "standard_error_mm": error,
        "noise_sd_mm": noise,
    }
    return Document(blocks, "lrm/alignment/1", values)
