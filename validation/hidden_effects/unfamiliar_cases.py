"""The second catalogue: hidden effects of which none has the tool's formula, on several arms, in awkward data.

One half is for tuning, the other for reporting: the same kinds of effect at other places, on other arms, with other
seeds.
"""

from __future__ import annotations

from validation.hidden_effects.case_generator import bending, combined, coupled, gain, lag, play, restart, shaft, warms
from validation.hidden_effects.second_unforeseen.cases import second_unforeseen
from validation.hidden_effects.unfamiliar_effects import (
    Half,
    UnfamiliarCase,
    axial_float,
    base_lifts,
    both,
    creeps,
    dahl_loop,
    five_levels,
    from_first_catalogue,
    gear_ripple,
    hinged,
    long_metre,
    nothing,
    on,
    one_load,
    radial_float,
    shared_cable,
    stick_slip,
    stops,
    tilting_bearing,
    unequal_play,
    warms_in_two_stages,
    weather,
    with_outliers,
)
from validation.hidden_effects.unforeseen_cases import unforeseen


def _tuning() -> tuple[UnfamiliarCase, ...]:
    half: Half = "tune"
    plain = nothing(half)
    return (
        hinged(half, 2, 103.5, 0.05),
        hinged(half, 4, 0.0, 0.12),
        tilting_bearing(half, 2, 0.8),
        unequal_play(half, 2, 0.9),
        stick_slip(half, 3, 0.5),
        dahl_loop(half, 1, 1.2),
        stops(half, 2, 1, 60.0),
        gear_ripple(half, 1, 4, 0.4),
        shared_cable(half, 3, 5, 0.15),
        warms_in_two_stages(half, 4, 0.8),
        weather(half, 2, 0.8),
        base_lifts(half, "x"),
        on("so101-like", from_first_catalogue(half, play(2, 1.2, 0.04))),
        on("three-joint", from_first_catalogue(half, lag(1, 1.0))),
        on("ur5-like", from_first_catalogue(half, gain(2, 1, 0.025))),
        with_outliers(from_first_catalogue(half, play(2, 1.2, 0.04))),
        one_load(from_first_catalogue(half, coupled(3, 2, 0.02))),
        five_levels(from_first_catalogue(half, shaft(2, 0.015))),
        both(unequal_play(half, 2, 0.9), gear_ripple(half, 1, 4, 0.4)),
        from_first_catalogue(half, combined(play(2, 2.4, 0.04), warms(2, 2.2))),
        both(stick_slip(half, 3, 0.5), weather(half, 2, 0.8)),
        plain,
        one_load(plain),
        on("so101-like", plain),
        on("three-joint", plain),
        creeps(half, 3, 0.08),
        axial_float(half, 3, 2.0),
        radial_float(half, 3, 1.5),
    )


def _reporting() -> tuple[UnfamiliarCase, ...]:
    half: Half = "report"
    plain = nothing(half)
    return (
        hinged(half, 4, 107.8, 0.10),
        hinged(half, 2, 0.0, 0.06),
        tilting_bearing(half, 4, 1.0),
        unequal_play(half, 3, 1.1),
        stick_slip(half, 1, 0.5),
        dahl_loop(half, 3, 1.4),
        stops(half, 3, -1, -60.0),
        gear_ripple(half, 2, 5, 0.4),
        shared_cable(half, 2, 4, 0.10),
        warms_in_two_stages(half, 2, 0.5),
        weather(half, 3, 1.0),
        base_lifts(half, "z"),
        on("ur5-like", from_first_catalogue(half, play(3, 1.6, 0.03))),
        on("seven-joint", from_first_catalogue(half, bending(2, 0.1, 6.0, 12.0))),
        on("so101-like", from_first_catalogue(half, lag(1, 1.0))),
        with_outliers(from_first_catalogue(half, warms(2, 0.7))),
        one_load(from_first_catalogue(half, play(2, 1.2, 0.04))),
        five_levels(from_first_catalogue(half, restart(1, 3, 0.6))),
        both(unequal_play(half, 3, 1.1), gear_ripple(half, 2, 5, 0.4)),
        both(hinged(half, 4, 107.8, 0.10), dahl_loop(half, 3, 1.4)),
        from_first_catalogue(half, combined(play(3, 1.6, 0.03), gain(1, 1, 0.02), warms(4, 1.1))),
        plain,
        five_levels(plain),
        on("ur5-like", plain),
        on("seven-joint", plain),
        with_outliers(plain),
        long_metre(half),
        creeps(half, 2, 0.06),
        axial_float(half, 2, 2.0),
        radial_float(half, 2, 1.5),
    )


UNFAMILIAR = {
    each.name + "/" + each.half: each for each in (*_tuning(), *_reporting(), *unforeseen(), *second_unforeseen())
}
