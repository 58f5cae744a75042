"""Names for people who have not read the catalogue: backlash in joint 2, δd1 for `offsets.joint1.d_mm`."""

from __future__ import annotations

from lrm_math.arm.place_names import place_words
from lrm_math.effects import EffectRef, ParameterRef, marked
from lrm_math.effects.session_errors import session_words
from lrm_math.model.step_name import StepName

PLAIN = {
    "offsets": "geometry error of {place}",
    "compliance": "compliance of {place}",
    "servo_droop": "servo droop of {place}",
    "base_compliance": "base compliance",
    "lateral_compliance": "lateral compliance of {place}",
    "bending_ends": "bending at the ends of {place}",
    "nonlinear_stiffness": "nonlinear stiffness of {place}",
    "backlash": "backlash in {place}",
    "axial_play": "axial play of {place}",
    "hysteresis": "hysteresis of {place}",
    "servo_gain": "servo gain error of {place}",
    "common_gain": "gain error of all servos",
    "eccentricity": "gear eccentricity of {place}",
    "quantisation": "quantisation of the servo of {place}",
    "cable_spring": "cable pull on {place}",
    "coupling": "coupling of {place}",
    "payload": "mass error of the load",
    "mass": "mass error of {place}",
    "gravity": "tilt of the base (direction of gravity)",
    "gear_ripple": "gear ripple of {place}",
    "creep": "creep of {place}",
    "self_heating": "self-heating of {place}",
    "slip": "slip of {place}",
    "drift": "warm-up drift of {place}",
    "change_point": "sudden shift of {place}",
    "second_change_point": "second sudden shift of {place}",
    "session": "session offset of {place}",
    "measurement_frame": "tracker scale error",
    "frame_curve": "tracker distortion (spline)",
    "anchor": "offset of the point that distances start from",
    "touched_point": "position of the touched point, {place}",
    "touched_board": "position of the board, {place}",
    "angle_curve": "angle error of {place} (spline)",
    "coupling_curve": "coupling of {place} (spline)",
    "cable_curve": "a free curve over {place} (spline)",
    "drift_curve": "drift of {place} (spline)",
    "torque_curve": "compliance of {place} (spline)",
    "bearing_curve": "bearing clearance of {place} (spline)",
    "base_curve": "base compliance (spline)",
    "friction_curve": "friction of {place} (spline)",
    "creep_spectrum": "creep of {place} at several paces",
    "residual_field": "remaining error without a name",
    "servo_response": "response of the servo of {place}",
    "rest_offset": "zero of {place}",
    "dead_time": "dead time of {place}",
    "sensor_delay": "delay of the reading of {place}",
    "speed_limit": "speed limit of {place}",
    "acceleration_limit": "acceleration limit of {place}",
    "drive_limit": "saturation of the drive of {place}",
    "motion_gain": "scale error of {place}",
    "velocity_feedforward": "velocity feedforward of {place}",
    "gravity_sag": "gravity sag of the servo of {place}",
    "inertial_coupling": "push of other joints on {place}",
    "link_inertia": "inertia of the links on {place}",
    "viscous_friction": "viscous friction of {place}",
    "coulomb_friction": "Coulomb friction of {place}",
    "load_friction": "load-dependent friction of {place}",
    "stribeck": "stick-slip (Stribeck friction) of {place}",
    "motion_play": "play of {place}",
    "swing": "swing of {place}",
}
OF_A_SESSION = ("drift", "drift_curve", "change_point", "second_change_point", "session")
"""Effects that may move everything alike."""
GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "theta": "θ"}


def plain_name(name: str) -> str:
    """Plain name of `id@place`; of a law or an effect of one's own, its id and place in words."""
    kind, _ = EffectRef.parse(name)
    words = PLAIN.get(kind, kind.replace("_", " ") + " of {place}")
    return marked(name, words.format(place=place_in_words(name)))


def place_in_words(name: str) -> str:
    """Where the effect `id@place` acts: `joint 2`, `base and tracker`."""
    kind, place = EffectRef.parse(name)
    return (session_words if kind in OF_A_SESSION else place_words)(place or "all places")


def step_title(step: StepName) -> str:
    """A step of a model's history in plain words: `fit`, or the plain name of the effect that was added."""
    return plain_name(step.added) if step.added else str(step)


def symbol(key: str) -> str:
    """The thesis's letters for a parameter (Conenna 2024, Table 4.3 and section 4.3), short enough for a figure.

    `offsets.joint1.d_mm` → δd1, `offsets.base.z_mm` → δz_b, `compliance.base.k_rad_per_Nm` → k0.

    The further translation of link i stands in the thesis at the joint that it leads to: `offsets.joint2.extra_z_mm` →
    δdd3. Parameters that the thesis does not have keep their key.
    """
    effect, place, name = ParameterRef.parse(key)
    bare = name.rsplit("_", 1)[0] if effect == "offsets" else name
    joint = int(place.removeprefix("joint")) if place.startswith("joint") and place[5:].isdigit() else None
    mimic = f"m{place.removeprefix('mimic')}" if place.startswith("mimic") else ""
    if effect == "compliance":
        return f"k{mimic or joint or 0}"
    if effect != "offsets":
        return key
    if joint is None:
        return f"δ{GREEK.get(bare, bare)}_{mimic or place[0]}"
    return f"δdd{joint + 1}" if bare == "extra_z" else f"δ{GREEK.get(bare, bare)}{joint}"
