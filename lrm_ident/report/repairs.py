"""What a person can do by hand about an effect, and whether the arm can correct it when it is modelled instead."""

from __future__ import annotations

from lrm_ident.report.plain_names import place_in_words
from lrm_math.effects import CATALOGUE, Effect, compensable

BY_HAND = {
    "axial_play": "take up the end play of {place}: a collar or a thrust bearing",
    "backlash": "preload or replace the gear of {place}",
    "base_compliance": "stiffen what the arm stands on",
    "cable_spring": "give the cables at {place} more slack",
    "change_point": "find what moved or was pushed: {place}",
    "common_gain": "check the pulse range (us per degree) of the servos",
    "coupling": "free the cables or mounts that link {place}",
    "creep": "relieve the plastic part under {place} at rest, or replace it by metal",
    "drift": "warm the arm up before it works",
    "eccentricity": "centre or replace the gear or sensor of {place}",
    "gear_ripple": "clean or replace the gear of {place}",
    "gravity": "level the base",
    "hysteresis": "grease {place}, or narrow its servo's dead band",
    "lateral_compliance": "stiffen the link of {place}",
    "mass": "weigh {place} and its screws again",
    "measurement_frame": "check the tracker with a known length",
    "nonlinear_stiffness": "tighten the screws at {place}, or replace its gear",
    "payload": "weigh the load and find its centre again",
    "self_heating": "let {place} rest between loads",
    "servo_gain": "measure the servo table of {place} again",
    "session": "clamp it so that it returns to the same place: {place}",
    "slip": "tighten the horn or clamp of {place}",
}
"""Imperatives by effect; of the others none is known."""


def by_hand(effect: Effect) -> str:
    """What to repair, or that the model corrects it; "" where nothing is known to do."""
    if effect.id not in BY_HAND or type(effect) not in CATALOGUE:
        return ""
    either = " (or leave it: the model corrects it)" if compensable(effect) else ""
    return f"{BY_HAND[effect.id].format(place=place_in_words(effect.name))}{either}"
