"""Report of a checkup: what the encoders name, what they cannot see, and what a video shows of the tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.data.wording import in_mm, joint_labels, p_words
from lrm_ident.measuring.recordings.encoder_checkup import MATTERS, Cause, EncoderCheckup, EncoderFinding
from lrm_ident.measuring.recordings.misread_joints import Misreading
from lrm_ident.report.document import Block, CommandLine, Document, ListSection, ResultTable, heading, section
from lrm_math.arm.arm import Arm

if TYPE_CHECKING:
    from lrm_ident.data.measurements import Measurements
    from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
    from lrm_ident.measuring.camera.session import CameraMeasurements
    from lrm_ident.study.study import Study

UNSEEN = (
    "Command and encoder cannot show backlash and bending behind the servo, lengths and angles of the parts, where "
    "camera or table stand, or a wrong zero that they share."
)
AGAIN = "Repair or recalibrate it, record two minutes with some stops, and type:"
BOARD = "Prints a board for lrm-ident camera read, which shows what encoders cannot see."
FEW = 2
"""Faults beside which the table of the joints has its place."""
CALIBRATE = "Calibrate it again, and the leader arm if one was used"
"""A recording does not state whether a leader arm, a gamepad or a program commanded the arm."""
WORDS: dict[Cause, str] = {
    "droop": "sags by up to {size} under gravity ({slope}): its servo yields. Raise its P gain, or calibrate the arm",
    "dead band": "stops at two angles, {size} apart, depending on the side it comes from (dead band, friction). Raise "
    "its P gain, let it cool, or replace the servo",
    "offset": f"stands {{size}} {{side}} its command everywhere: command and encoder have different zeros. {CALIBRATE}",
    "drift": "drifts by {size} while it works: it warms up. Reduce its load, or record when it is warm",
    "slip": "jumps by {size} before stop {rest} (episode {episode}) and stays there: its zero moved, because something "
    "slipped or it was recalibrated. Tighten its screws and calibrate it again",
    "gain": f"turns {{gain}} times as far as it is commanded, off by up to {{size}}. {CALIBRATE}",
    "full turn": "reads a full turn beside {turned}: it crosses the seam of its encoder. Calibrate it in the "
    "middle of its range",
    "reversed": f"turns against its command. Set drive_mode of its motor. If that does not help: {CALIBRATE.lower()}",
    "swapped": "follows the command of {other}. Check whether the ids or the plugs of the two motors are swapped",
    "frozen": "stands still at {rests} while it is commanded to move, up to {size} off. Check that its motor "
    "answers and that its torque is on",
    "unit": "is off by up to {size}: {what}. Record with use_degrees=true",
    "limits": "stands up to {size} beyond its limits at {rests}. Check that this is its arm file, and its zero",
    "not read": "has no number in {frames}, which are left out: a loose cable, or a motor that does not answer. "
    "Check both",
    "unexplained": "is off its command by {size} RMS, and no known cause explains it. Look at it",
}
SHOWN, NEW = 5, "NEW_RECORDING"


def checkup_document(checked: EncoderCheckup, arm: Arm, name: str) -> Document:
    """Result of `lrm-ident checkup`, schema `lrm/checkup/1`."""
    names = joint_labels(arm)
    before, after = np.degrees(checked.before), np.degrees(checked.after)
    rows = list(zip(names, before.tolist(), after.tolist(), strict=True))
    title = f"Command minus encoder at {checked.rests} stops of {name}"
    table = ResultTable(("joint", "rms_deg|.2f", "unexplained_deg|.2f"), rows)
    shown = ResultTable(("joint", "RMS, deg|.2f", "left when explained, deg|.2f"), rows, title)
    again: tuple[Block, ...] = ("", f"Next: {AGAIN}", CommandLine(f"      lrm-ident checkup {NEW}"))
    also = "Also" if checked.findings else "Next"
    few = len(checked.findings) <= FEW
    blocks: list[Block] = [
        heading(_headline(checked)),
        *(f"  {_words(finding, names, checked)}." for finding in checked.findings),
        UNSEEN,
        *(again if checked.findings else ("",)),
        CommandLine(f"{also}: lrm-ident camera board -o board.pdf"),
        f"      {BOARD}",
        *(("", shown) if few else ()),
    ]
    findings = [
        {
            "joint": names[finding.joint], "cause": finding.cause, "size_deg": np.degrees(finding.size),
            "sign": finding.sign,
            "slope_deg_per_Nm": np.degrees(finding.slope) if finding.cause == "droop" else None,
            "first_rest": finding.rest, "p_value": finding.p_value,
            "gain": finding.slope if finding.cause == "gain" else None,
            "other_joint": other_joint(finding.misread, names), "frames": list(finding.frames) or None,
        }
        for finding in checked.findings
    ]  # fmt: skip
    values = {"dataset": name, "arm": arm.name, "rests": checked.rests, "joints": table.records(), "findings": findings}
    details = [] if few else [shown]
    return Document(blocks, "lrm/checkup/1", values, details=details, about="the error of every joint")


def _headline(checked: EncoderCheckup) -> str:
    """How many faults there are, and how sure that is."""
    count, least = len(checked.findings), f"{np.degrees(MATTERS):.1f} deg"
    if not count:
        return f"No fault found: no joint is off its command by {least} or more for a cause that encoders show."
    chance = max(finding.p_value for finding in checked.findings)
    sure = "" if chance == 0.0 else f" (chance alone: p {p_words(chance)})"
    return f"{count} fault{'s' if count > 1 else ''} found by command and encoder{sure}:"


def card_paragraph(checked: EncoderCheckup, arm: Arm) -> str:
    """Markdown for the card of a dataset: how far its commands and encoders agree, and what the arm has."""
    names, rms = joint_labels(arm), np.degrees(checked.before)
    worst = int(rms.argmax())
    named = [f"- {_words(finding, names, checked)}" for finding in checked.findings]
    lines = [
        "## Check of the arm", "",
        f"`lrm-ident checkup` compared command (`action`) and encoder (`observation.state`) at {checked.rests} stops "
        f"of {arm.name}. They differ by {np.median(rms):.2f}° RMS (median joint) and {rms[worst]:.2f}° "
        f"({names[worst]}).",
        "", *(named or ["No joint has a fault that encoders show."]),
        "", "Encoders cannot show play behind a servo, bent parts, or a zero that command and encoder share.",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _words(finding: EncoderFinding, names: Sequence[str], checked: EncoderCheckup) -> str:
    if finding.misread is not None:
        return misread_words(finding.misread, names)
    rest, count = finding.rest or 0, len(finding.frames)
    frames = f"{count} frames ({finding.frames[0]} to {finding.frames[-1]})" if finding.frames else ""
    return f"{names[finding.joint]} " + WORDS[finding.cause].format(
        size=f"{np.degrees(finding.size):.1f} deg", slope=f"{np.degrees(finding.slope):.1f} deg per N·m",
        side="above" if finding.sign > 0 else "below", rest=rest + 1, episode=int(checked.episode[rest]),
        gain=f"{finding.slope:.3g}", frames=frames,
    )  # fmt: skip


def misread_words(misread: Misreading, names: Sequence[str]) -> str:
    """The mistake at a joint in words, and what a person does about it."""
    rests = f"{misread.rests} stop{'s' if misread.rests > 1 else ''}"
    turned = f"its limits at {rests}, {misread.what}" if misread.what else f"its command at {rests}"
    return f"{names[misread.joint]} " + WORDS[misread.mistake].format(
        size=f"{np.degrees(misread.size):.1f} deg",
        turned=turned,
        other=other_joint(misread, names),
        what=misread.what,
        rests=rests,
    )


def other_joint(misread: Misreading | None, names: Sequence[str]) -> str | None:
    """The joint that one is swapped with; None of all other mistakes."""
    return None if misread is None or misread.other is None else names[misread.other]


def studied(data: Measurements) -> tuple[Sequence[tuple[str, Study]], DiagnosisReport]:
    """The fit, and with what the diagnosis names, if it names anything. Raises `LrmError`."""
    from lrm_ident.study.study import Study  # here: a checkup without video computes nothing

    fitted = Study.of(data).fit()
    diagnosis = fitted.diagnose()
    if diagnosis.first is None:
        return [("fitted", fitted)], diagnosis
    name = diagnosis.first.scored.name
    return [("fitted", fitted), (f"with {name}", fitted.add(name))], diagnosis


def with_video(
    document: Document,
    photos: CameraMeasurements,
    result: tuple[Sequence[tuple[str, Study]], DiagnosisReport],
    output: Path,
) -> Document:
    """Result of `lrm-ident checkup --video`: that of the encoders, and the table `video`."""
    steps, checked = result
    nominal = steps[0][1].errors.nominal
    rows: list[tuple[str, float, float | None]] = [("nominal", 1e3 * nominal.rms, None)]
    for name, study in steps:
        held_out = study.errors.held_out.error
        rows.append((name, 1e3 * study.errors.fitted.rms, None if held_out is None else 1e3 * held_out.rms))
    table = ResultTable(("model", "rms_mm|.2f", "held_out_rms_mm|.2f"), rows, "Tip, by the board in the video")
    of_no_use = [f"{name}: {why}" for name, why in photos.photos.refused]
    count = len(photos.data) + len(of_no_use)
    blocks: list[Block] = [f"The board is seen at {len(photos.data)} of {count} stops; {_known(photos)}."]
    if of_no_use:
        blocks.append(ListSection(f"{len(of_no_use)} stops are of no use:", tuple(of_no_use[:SHOWN])))
    blocks.append(table)
    named = None if checked.first is None else checked.first.scored.name
    words = checked.verdict.replace("_", " ") if checked.first is None else checked.first.why
    next_one = f"lrm-ident fit {output} -o model.toml; lrm-ident diagnose model.toml {output}"
    blocks += section("What the video shows", (words, f"Measurements written to {output}. For the details: {next_one}"))
    video = {
        "rests": count, "used": len(photos.data), "refused": dict(photos.photos.refused), "verdict": checked.verdict,
        "named": named, "errors": table.records(),
    }  # fmt: skip
    return replace(document, blocks=[*document.blocks, *blocks], values={**document.values, "video": video})


def _known(photos: CameraMeasurements) -> str:
    sd = np.sqrt(np.einsum("nii->ni", photos.data.positions.covariance))
    return f"the tip is known to {in_mm(float(np.median(sd)))} mm per axis"
