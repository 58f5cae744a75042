"""The fifth part of the second catalogue: ten fresh causes alone, and five beside one that the catalogue knows.

Sizes, places and right names were decided before the tool saw any of them. In mixed worlds the first truth is known.
"""

from __future__ import annotations

from validation.hidden_effects.case_generator import DEG, MM, gain, lag, play, shaft, warms
from validation.hidden_effects.third_unforeseen.effects import (
    CyclicDistance,
    LevellingTable,
    MagnetByTheArm,
    OvalFlexspline,
    ProbePretravel,
    RoutedBowden,
    SofteningByHeat,
    StuckBit,
    SwellingLink,
    TwoJointSpring,
)
from validation.hidden_effects.unfamiliar_effects import Half, UnfamiliarCase, both, from_first_catalogue, hidden, on

HALF: Half = "third-unforeseen"
SO101, UR5 = "so101-like", "ur5-like"
METER_M = (1.1, 0.5, 0.4)


def third_unforeseen() -> tuple[UnfamiliarCase, ...]:
    """All cases, on three arms."""
    return (*_alone(), *_mixed())


def _alone() -> tuple[UnfamiliarCase, ...]:
    heat, bowden = "nonlinear_stiffness@joint2 drift@joint2", "hysteresis@joint3 coupling@joint3<-joint2"
    spring = "cable_spring@joint2 cable_spring@joint3"
    return (
        on(UR5, magnet()),
        on(SO101, cyclic()),
        hidden(HALF, "oval", "nonlinear_stiffness@joint2", lambda by: OvalFlexspline(2, by.size(0.02), 0.7)),
        swelling(),
        on(SO101, hidden(HALF, "air-table", "base_compliance@base", lambda by: LevellingTable(by.size(0.012), 0.3))),
        hidden(HALF, "softening", heat, lambda by: SofteningByHeat(2, by.size(0.02), 500.0)),
        on(SO101, hidden(HALF, "bowden", bowden, lambda by: RoutedBowden(3, 2, by.size(0.6 * DEG)))),
        on(
            UR5,
            hidden(
                HALF,
                "two-joint-spring",
                spring,
                lambda by: TwoJointSpring((-0.05, -0.04), 0.17, 0.06, 0.12, by.size(15.0)),
            ),
        ),
        stuck(2),
        on(UR5, pretravel()),
    )


def _mixed() -> tuple[UnfamiliarCase, ...]:
    known = (play(2, 1.2, 0.04), lag(3, 1.2), gain(2, 1, 0.025), shaft(1, 0.015), warms(2, 0.5))
    first = tuple(from_first_catalogue(HALF, case) for case in known)
    return (
        on(UR5, both(first[0], magnet())),
        on(SO101, both(first[1], cyclic())),
        both(first[2], swelling()),
        on(UR5, both(first[3], pretravel())),
        on(SO101, both(first[4], stuck(3))),
    )


def magnet() -> UnfamiliarCase:
    """A magnet draws the gripper."""
    return hidden(HALF, "magnet", None, lambda by: MagnetByTheArm((0.25, -0.2, 0.15), by.size(5.0), 0.1))


def cyclic() -> UnfamiliarCase:
    """The distance errs by a wave."""
    return hidden(HALF, "cyclic", None, lambda by: CyclicDistance(METER_M, 0.12, by.size(2.0 * MM)))


def swelling() -> UnfamiliarCase:
    """The second link grows."""
    return hidden(HALF, "swelling", None, lambda by: SwellingLink(2, (by.size(4.0 * MM), 0.0, by.size(2.0 * MM))))


def stuck(joint: int) -> UnfamiliarCase:
    """A bit of an encoder is stuck."""
    return hidden(HALF, "stuck-bit", None, lambda _: StuckBit(joint, 360.0 * DEG / 512.0))


def pretravel() -> UnfamiliarCase:
    """The probe bends before it tells."""
    return hidden(HALF, "pretravel", None, lambda by: ProbePretravel(by.size(2.0 * MM)))
