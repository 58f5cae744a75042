"""Plain names: places and code names in the sentences of a report."""

from __future__ import annotations

from lrm_ident.report.plain_names import in_words
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects.curves import CouplingCurve
from lrm_math.effects.servo_errors import Coupling


def test_names_in_sentences_are_words() -> None:
    assert in_words("From backlash@joint2, coupling@joint3<-joint2: add it") == (
        "From backlash in joint 2, coupling of joint 3 by joint 2: add it"
    )
    assert in_words("cable_curve@joint1+joint2 follows q1, tau4; joint5.") == (
        "a free curve over joints 1 and 2 (spline) follows the angle of joint 1, the torque of joint 4; joint 5."
    )


def test_names_of_columns_and_parameters_stay() -> None:
    said = "q1_meas_deg and offsets.joint2.a_mm, compliance.base.k_rad_per_Nm, k"
    assert in_words(said) == said


def test_what_couples_two_joints_says_which_follows() -> None:
    arm = load_arm("lrm-lab")
    for kind in (Coupling, CouplingCurve):
        assert kind.about.claim.startswith("{place} by ")
        assert kind(arm, "joint3<-joint2").place_in_words == "joint 3 follows joint 2"
