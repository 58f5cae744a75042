"""The fourth part of the second catalogue: a test of what `auto` claims, by causes that nothing was set by.

Whoever wrote them had not read how `auto` decides. Eighteen causes alone, eight beside one that the catalogue knows
(the first of the truths), six known ones alone, and three arms with nothing hidden.
"""

from __future__ import annotations

from validation.hidden_effects.case_generator import DEG, MM, bending, gain, lag, play, shaft, warms
from validation.hidden_effects.second_unforeseen.effects import (
    BeltPolygon,
    CapstanFriction,
    DifferentialPlay,
    EmptyingBattery,
    FanCycles,
    FoamMat,
    GlareSpot,
    HangingHose,
    HelicalThrust,
    MarkerOnJaw,
    OverloadProtection,
    RingingTip,
    ShearingPlates,
    SlippingClutch,
    StereoSteps,
    TelescopingTube,
    WalkingBase,
    WobblingTurntable,
)
from validation.hidden_effects.unfamiliar_effects import (
    Half,
    UnfamiliarCase,
    both,
    from_first_catalogue,
    hidden,
    nothing,
    on,
)

HALF: Half = "second-unforeseen"
SO101, UR5 = "so101-like", "ur5-like"
CAMERA_M = (0.9, -0.7, 0.6)
MOVED_BASE = "drift@base change_point@base session@base drift@joint1 change_point@joint1"


def second_unforeseen() -> tuple[UnfamiliarCase, ...]:
    """All cases, on three arms."""
    return (*_alone(), *_mixed(), *_controls())


def _alone() -> tuple[UnfamiliarCase, ...]:
    return (
        battery(),
        on(SO101, _of_torque()),
        _differential(),
        on(UR5, _capstan()),
        turntable(),
        _plates(),
        _tube(),
        glare(),
        on(UR5, stereo()),
        on(SO101, jaw(5)),
        on(UR5, mat(0.26)),
        on(SO101, _walks()),
        clutch(),
        _hose(),
        _thrust(),
        on(UR5, _fan()),
        on(SO101, hidden(HALF, "ringing", None, lambda by: RingingTip(by.size(0.004), 7))),
        on(SO101, belt()),
    )


def _mixed() -> tuple[UnfamiliarCase, ...]:
    first = tuple(
        from_first_catalogue(HALF, case)
        for case in (
            play(2, 1.2, 0.04),
            lag(3, 1.2),
            gain(2, 1, 0.025),
            shaft(1, 0.015),
            bending(2, 0.1, 6.0, 12.0),
            play(3, 1.6, 0.03),
            lag(1, 1.0),
            gain(3, 1, 0.015),
        )
    )
    return (
        both(first[0], turntable()),
        on(SO101, both(first[1], jaw(5))),
        both(first[2], battery()),
        on(UR5, both(first[3], stereo())),
        both(first[4], clutch()),
        on(UR5, both(first[5], mat(0.26))),
        both(first[6], glare()),
        on(SO101, both(first[7], belt())),
    )


def _controls() -> tuple[UnfamiliarCase, ...]:
    known = (
        (UR5, play(2, 1.2, 0.04)),
        (SO101, lag(3, 1.2)),
        ("", gain(2, 1, 0.025)),
        (UR5, shaft(1, 0.015)),
        ("", bending(2, 0.1, 6.0, 12.0)),
        (SO101, warms(2, 0.5)),
    )
    plain = nothing(HALF)
    cases = [(arm, from_first_catalogue(HALF, case)) for arm, case in known]
    return (*(on(arm, case) if arm else case for arm, case in cases), plain, on(SO101, plain), on(UR5, plain))


def battery() -> UnfamiliarCase:
    """All servos weaken."""
    return hidden(HALF, "battery", None, lambda by: EmptyingBattery(by.size(0.018)))


def turntable() -> UnfamiliarCase:
    """The axis of joint 1 nods."""
    return hidden(HALF, "turntable", None, lambda by: WobblingTurntable(by.size(0.4 * DEG)))


def glare() -> UnfamiliarCase:
    """The bright spot of a ball moves."""
    return hidden(HALF, "glare", None, lambda by: GlareSpot(6, by.size(3.0 * MM)))


def stereo() -> UnfamiliarCase:
    """The distance comes in steps."""
    return hidden(HALF, "stereo", None, lambda by: StereoSteps(CAMERA_M, by.size(0.006)))


def jaw(last_link: int) -> UnfamiliarCase:
    """The target moves with the load."""
    return hidden(HALF, "jaw", None, lambda by: MarkerOnJaw(last_link, (by.size(3.0 * MM), by.size(1.5 * MM), 0.0)))


def mat(top_m: float) -> UnfamiliarCase:
    """The tip rests on foam."""
    return hidden(HALF, "mat", None, lambda by: FoamMat(top_m, by.size(0.04)))


def belt() -> UnfamiliarCase:
    """The shoulder's belt lies as a polygon."""
    return hidden(HALF, "belt", None, lambda by: BeltPolygon(2, 20, by.size(0.5 * DEG)))


def clutch() -> UnfamiliarCase:
    """The third joint slips by and by."""
    right = "change_point@joint3"
    return hidden(HALF, "clutch", right, lambda by: SlippingClutch(3, 0.2, by.size(0.009)))


def _of_torque() -> UnfamiliarCase:
    return hidden(HALF, "overload", "nonlinear_stiffness@joint2", lambda by: OverloadProtection(2, 0.3, by.size(0.018)))


def _differential() -> UnfamiliarCase:
    right = "backlash@joint4 backlash@joint5"
    return hidden(HALF, "differential", right, lambda by: DifferentialPlay((4, 5), by.size(1.6 * DEG), 0.02))


def _capstan() -> UnfamiliarCase:
    return hidden(HALF, "capstan", "hysteresis@joint2", lambda by: CapstanFriction(2, by.size(0.3 * DEG), 0.8))


def _plates() -> UnfamiliarCase:
    return hidden(HALF, "plates", "lateral_compliance@link2", lambda by: ShearingPlates(2, by.size(0.0007)))


def _tube() -> UnfamiliarCase:
    return hidden(HALF, "tube", None, lambda by: TelescopingTube(4, by.size(15.0 * MM)))


def _walks() -> UnfamiliarCase:
    return hidden(HALF, "walking-base", MOVED_BASE, lambda by: WalkingBase(by.size(0.0012), 60.0 * DEG))


def _hose() -> UnfamiliarCase:
    right = "mass@link4 mass@link5 mass@link6 payload@tool"
    return hidden(HALF, "hose", right, lambda by: HangingHose(by.size(0.15)))


def _thrust() -> UnfamiliarCase:
    return hidden(HALF, "thrust", "axial_play@joint3", lambda by: HelicalThrust(2, by.size(2.0 * MM), 0.05))


def _fan() -> UnfamiliarCase:
    return hidden(HALF, "fan", "drift@joint2", lambda by: FanCycles(2, by.sign() * by.size(1.2 * DEG), 960.0))
