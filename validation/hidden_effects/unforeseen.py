"""Causes thought of by somebody who had not written the tool, with the names that would be right, decided beforehand.

Three parts, each run once before anything was learned from it: `unforeseen` (counts of later runs are in
docs/results.md; on what was learned from it they say less since), `blind` by somebody who had not read how `auto`
decides, and `fresh` for a second test of what it claims. In mixed worlds the first truth is one that the catalogue
knows. Joints and links count from 1 (link 0: the base).
"""

from __future__ import annotations

from collections.abc import Callable

from validation.hidden_effects.case import (
    BLIND,
    DEG,
    FRESH,
    LAB,
    MM,
    SO101,
    UNFORESEEN,
    UR5,
    Case,
    RandomSizes,
    hidden,
    nothing,
    of_part,
    on,
    together,
)
from validation.hidden_effects.causes import bending, gain, lag, play, shaft, warms
from validation.synthetic import FormulaJoint, HiddenEffect, JointSlip
from validation.synthetic import hidden_joints as joints
from validation.synthetic import hidden_links as links
from validation.synthetic import hidden_memory as memory
from validation.synthetic import hidden_tracker as tracker
from validation.synthetic.hidden_bodies import HangingHose, UnstatedPayload

Make = Callable[[RandomSizes], HiddenEffect]
Row = tuple[str, str, str | None, Make]
"""Arm, name, the names that are right, and the effect."""
BASE, MOVED_BASE = "base_compliance@base", "drift@base change_point@base session@base drift@joint1 change_point@joint1"
LAST_MASSES = "mass@link4 mass@link5 mass@link6 payload@tool"
METER_M, CAMERA_M = (1.1, 0.5, 0.4), (0.9, -0.7, 0.6)


def _cases(part: str, *rows: Row) -> tuple[Case, ...]:
    return tuple(_on(arm, hidden(part, name, right, make)) for arm, name, right, make in rows)


def _on(arm: str, case: Case) -> Case:
    return case if arm == LAB else on(arm, case)


def _snag(by: RandomSizes) -> HiddenEffect:
    """A cable that catches where two other joints stand near some angles."""
    near = "np.exp(-0.5 * ((q[3] - 0.4) ** 2 + (q[4] + 0.3) ** 2) / 0.45**2)"
    return FormulaJoint(2, by.sign() * by.size(1.3 * DEG), near)


def _dead_band(by: RandomSizes) -> HiddenEffect:
    """A potentiometer without a reading between two angles: the servo runs on to their middle."""
    half = by.size(9.0 * DEG)
    return FormulaJoint(2, 1.0, f"np.where(np.abs(q[2] - 0.2) < {half}, 0.2 - q[2], 0.0)")


def _shared_supply(by: RandomSizes) -> HiddenEffect:
    """A servo that gives way more while another one draws current."""
    return FormulaJoint(2, by.size(0.12), "tau * np.abs(torque[3])")


def _slip(by: RandomSizes) -> HiddenEffect:
    return JointSlip(2, by.sign() * by.size(0.9 * DEG), 1650.0)


FIRST = (
    *_cases(
        UNFORESEEN,
        (LAB, "crack", "lateral_compliance@link2", lambda by: links.CrackedLink(2, by.size(0.10))),
        (LAB, "log-creep", None, lambda by: links.LogarithmicCreep(2, by.size(0.02), 300.0)),
        (SO101, "loose-base", BASE, lambda by: links.LooseBase(0, by.size(0.6 * DEG))),
        (LAB, "table", BASE, lambda by: links.StiffeningTable(0, by.size(0.01))),
        (SO101, "bouc-wen", "hysteresis@joint2", lambda by: memory.BoucWenFriction(2, by.size(0.9 * DEG), 15 * DEG)),
        (SO101, "dead-band", None, _dead_band),
        (LAB, "snag", None, _snag),
        (UR5, "snag", None, _snag),
        (LAB, "horn-slip", "change_point@joint2", _slip),
        (UR5, "horn-slip", "change_point@joint2", _slip),
        (LAB, "shared-supply", None, _shared_supply),
    ),
    hidden(UNFORESEEN, "forgotten-load", None, lambda by: UnstatedPayload(by.size(0.06)), sessions=2),
    *_cases(
        UNFORESEEN,
        (LAB, "hidden-marker", None, lambda by: tracker.OccludedMarker(by.size(3.0 * MM))),
        (LAB, "noise-of-distance", None, lambda by: tracker.DistanceDependentNoise(by.size(1.2 * MM), 5)),
    ),
    *(_on(arm, nothing(UNFORESEEN)) for arm in (LAB, SO101, UR5)),
)


def _capstan(by: RandomSizes) -> HiddenEffect:
    """A string drive whose friction grows e-fold with the angle of wrap (Euler, Eytelwein)."""
    return FormulaJoint(2, by.size(0.3 * DEG), "-side * np.exp(0.8 * q[2])")


def _jaw(by: RandomSizes) -> HiddenEffect:
    return links.MarkerOnJaw(5, (by.size(3.0 * MM), by.size(1.5 * MM), 0.0))


ALONE = _cases(
    BLIND,
    (LAB, "battery", None, lambda by: memory.EmptyingBattery(by.size(0.018))),
    (SO101, "overload", "nonlinear_stiffness@joint2", lambda by: memory.OverloadProtection(2, 0.3, by.size(0.018))),
    (
        LAB,
        "differential",
        "backlash@joint4 backlash@joint5",
        lambda by: joints.DifferentialPlay((4, 5), by.size(1.6 * DEG), 0.02),
    ),
    (UR5, "capstan", "hysteresis@joint2", _capstan),
    (LAB, "turntable", None, lambda by: links.WobblingTurntable(by.size(0.4 * DEG))),
    (LAB, "plates", "lateral_compliance@link2", lambda by: links.ShearingPlates(2, by.size(0.0007))),
    (LAB, "tube", None, lambda by: links.TelescopingTube(4, by.size(15.0 * MM))),
    (LAB, "glare", None, lambda by: links.GlareSpot(6, by.size(3.0 * MM))),
    (UR5, "stereo", None, lambda by: tracker.StereoSteps(CAMERA_M, by.size(0.006))),
    (SO101, "jaw", None, _jaw),
    (UR5, "mat", None, lambda by: tracker.FoamMat(0.26, by.size(0.04))),
    (SO101, "walking-base", MOVED_BASE, lambda by: links.WalkingBase(by.size(0.0012), 60.0 * DEG)),
    (LAB, "clutch", "change_point@joint3 slip@joint3", lambda by: memory.SlippingClutch(3, 0.2, by.size(0.009))),
    (LAB, "hose", LAST_MASSES, lambda by: HangingHose(by.size(0.15))),
    (LAB, "thrust", "axial_play@joint3", lambda by: links.HelicalThrust(2, by.size(2.0 * MM), 0.05)),
    (UR5, "fan", "drift@joint2", lambda by: memory.FanCycles(2, by.sign() * by.size(1.2 * DEG), 960.0)),
    (SO101, "ringing", None, lambda by: tracker.RingingTip(by.size(0.004), 7)),
    (SO101, "belt", "gear_ripple@joint2", lambda by: joints.BeltPolygon(2, 20, by.size(0.5 * DEG))),
)


def _oval(by: RandomSizes) -> HiddenEffect:
    """A strain wave gear that is stiffer at two opposite angles than between."""
    return FormulaJoint(2, by.size(0.02), "tau * np.cos(2.0 * q[2] + 0.7)")


def _bowden(by: RandomSizes) -> HiddenEffect:
    """A joint's Bowden cable over the joint before, which drags it along by the friction in its sheath."""
    return FormulaJoint(3, by.size(0.6 * DEG), "-np.tanh(way[2] / 0.1)")


def _stuck_bit(joint: int) -> Make:
    """An encoder of which one bit is stuck at 0: half of all angles are read too small by it."""
    bit = 360.0 * DEG / 512.0
    return lambda _: FormulaJoint(joint, bit, f"np.floor(q[{joint}] / {bit}) % 2.0")


FRESH_ALONE = _cases(
    FRESH,
    (UR5, "magnet", None, lambda by: joints.MagnetByTheArm((0.25, -0.2, 0.15), by.size(5.0), 0.1)),
    (SO101, "cyclic", None, lambda by: tracker.CyclicDistance(METER_M, 0.12, by.size(2.0 * MM))),
    (LAB, "oval", "nonlinear_stiffness@joint2", _oval),
    (LAB, "swelling", None, lambda by: links.SwellingLink(2, (by.size(4.0 * MM), 0.0, by.size(2.0 * MM)))),
    (SO101, "air-table", BASE, lambda by: links.LevellingTable(by.size(0.012), 0.3)),
    (
        LAB,
        "softening",
        "nonlinear_stiffness@joint2 drift@joint2",
        lambda by: memory.SofteningByHeat(2, by.size(0.02), 500.0),
    ),
    (SO101, "bowden", "hysteresis@joint3 coupling@joint3<-joint2", _bowden),
    (
        UR5,
        "two-joint-spring",
        "cable_spring@joint2 cable_spring@joint3",
        lambda by: joints.TwoJointSpring((-0.05, -0.04), 0.17, 0.06, 0.12, by.size(15.0)),
    ),
    (LAB, "stuck-bit", None, _stuck_bit(2)),
    (UR5, "pretravel", None, lambda by: tracker.ProbePretravel(by.size(2.0 * MM))),
)


def _of(cases: tuple[Case, ...]) -> dict[str, Case]:
    """Cases by their names, on the arm of the lab."""
    plain = [case.name.removesuffix(f" on {case.arm}") for case in cases]
    return {name: Case(name, case.truths, case.build, case.part) for name, case in zip(plain, cases, strict=True)}


def _mixed(part: str, *pairs: tuple[str, Case, Case]) -> tuple[Case, ...]:
    return tuple(_on(arm, together(of_part(part, known), other)) for arm, known, other in pairs)


_blind, _fresh = _of(ALONE), _of(FRESH_ALONE)
STUCK3 = hidden(FRESH, "stuck-bit", None, _stuck_bit(3))
PLAY2, LAG3, GAIN2, SHAFT1 = play(2, 1.2, 0.04), lag(3, 1.2), gain(2, 1, 0.025), shaft(1, 0.015)
BENDING2, WARMS2 = bending(2, 0.1, 6.0, 12.0), warms(2, 0.5)
BLIND_CASES = (
    *ALONE,
    *_mixed(
        BLIND,
        (LAB, PLAY2, _blind["turntable"]),
        (SO101, LAG3, _blind["jaw"]),
        (LAB, GAIN2, _blind["battery"]),
        (UR5, SHAFT1, _blind["stereo"]),
        (LAB, BENDING2, _blind["clutch"]),
        (UR5, play(3, 1.6, 0.03), _blind["mat"]),
        (LAB, lag(1, 1.0), _blind["glare"]),
        (SO101, gain(3, 1, 0.015), _blind["belt"]),
    ),
    *(
        _on(arm, of_part(BLIND, known))
        for arm, known in ((UR5, PLAY2), (SO101, LAG3), (LAB, GAIN2), (UR5, SHAFT1), (LAB, BENDING2), (SO101, WARMS2))
    ),
    *(_on(arm, nothing(BLIND)) for arm in (LAB, SO101, UR5)),
)
FRESH_CASES = (
    *FRESH_ALONE,
    *_mixed(
        FRESH,
        (UR5, PLAY2, _fresh["magnet"]),
        (SO101, LAG3, _fresh["cyclic"]),
        (LAB, GAIN2, _fresh["swelling"]),
        (UR5, SHAFT1, _fresh["pretravel"]),
        (SO101, WARMS2, STUCK3),
    ),
)
