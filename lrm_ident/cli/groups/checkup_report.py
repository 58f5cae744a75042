"""Report of a checkup: what the encoders name, in words that an owner can act on, and what they cannot see."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.recordings.encoder_checkup import MATTERS, Cause, EncoderCheckup, EncoderFinding
from lrm_ident.report.document import Block, Document, ResultTable, section
from lrm_math.arm.arm import Arm

UNSEEN = (
    "play and bending behind the servo: backlash of its gears, links and screws that give way",
    "lengths and angles of the parts, and where the camera or the table really stands",
    "a zero that command and encoder share: the arm stands elsewhere than both say",
)
HOW = "photos of a printed board show these (lrm-ident camera board, camera read), or a tracker does (measure)"
WORDS: dict[Cause, str] = {
    "droop": "sags by up to {size} under gravity ({slope}): its servo yields; raise its P gain, or calibrate the arm",
    "dead band": "stops {size} apart from its two sides (dead band, friction): a worn or hot servo, or a low P gain",
    "offset": "stands {size} {side} its command everywhere: leader and follower have other zeros; calibrate both again",
    "drift": "drifts by {size} while it works: it warms up; look at its load, or record when it is warm",
    "slip": "jumps by {size} before rest {rest} (episode {episode}) and stays: a horn slipped, or it was recalibrated",
}


def checkup_document(found: EncoderCheckup, arm: Arm, name: str) -> Document:
    """Result of `lrm-ident checkup`, schema `lrm/checkup/1`."""
    names = joint_labels(arm)
    before, after = np.degrees(found.before), np.degrees(found.after)
    rows = list(zip(names, before.tolist(), after.tolist(), strict=True))
    title = f"{name}: action − state at {found.rests} rests"
    table = ResultTable(("joint", "rms_deg|.2f", "unexplained_deg|.2f"), rows, title)
    lines = [_words(one, names[one.joint], found) for one in found.findings]
    if not lines:
        lines = [
            f"Nothing: no joint is off its command by {np.degrees(MATTERS):.1f} deg for any cause that encoders show."
        ]
    blocks: list[Block] = [table, *section("What the encoders tell", lines)]
    blocks += section("What they cannot see", (*UNSEEN, HOW))
    findings = [
        {
            "joint": names[one.joint], "cause": one.cause, "size_deg": np.degrees(one.size), "sign": one.sign,
            "slope_deg_per_Nm": np.degrees(one.slope) if one.cause == "droop" else None,
            "first_rest": one.rest, "p_value": one.p_value,
        }
        for one in found.findings
    ]  # fmt: skip
    values = {"dataset": name, "arm": arm.name, "rests": found.rests, "joints": table.records(), "findings": findings}
    return Document(blocks, "lrm/checkup/1", values)


def _words(one: EncoderFinding, name: str, found: EncoderCheckup) -> str:
    rest = one.rest or 0
    return f"{name} " + WORDS[one.cause].format(
        size=f"{np.degrees(one.size):.1f} deg", slope=f"{np.degrees(one.slope):.1f} deg per N·m",
        side="above" if one.sign > 0 else "below", rest=rest + 1, episode=int(found.episode[rest]),
    )  # fmt: skip
