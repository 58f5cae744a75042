"""The catalogue of what goes wrong in a measurement: every fault with the verdicts that are honest in the end."""

from __future__ import annotations

from validation.hidden_effects.case import FAULTS, FAULTS_BLIND, Case
from validation.hidden_effects.faults import blind, loose_parts, people, trackers, transmissions
from validation.hidden_effects.faults.measurement import HONEST, QUIET, Fault

UNKNOWN = ("noise_unknown",)


def _case(name: str, spoil: Fault, verdicts: tuple[str, ...] = QUIET, noise_known: bool = True) -> Case:
    return Case(name, (), part=FAULTS, spoil=spoil, verdicts=verdicts, noise_known=noise_known)


def _blind(name: str, spoil: Fault, verdicts: tuple[str, ...] = HONEST) -> Case:
    return Case(name, (), part=FAULTS_BLIND, spoil=spoil, verdicts=verdicts)


FAULT_CASES = (
    _case("a block carries the row before", people.block),
    _case("four pairs of rows swapped", people.swapped),
    _case("tracker moved between sessions", trackers.moved_between),
    _case("tracker moved meanwhile", trackers.moved_meanwhile),
    _case("tracker moved twice", trackers.moved_twice, HONEST),
    _case("a joint skipped a tooth", loose_parts.skipped_tooth),
    _case("the reflector slipped", loose_parts.reflector_slipped),
    _case("a loose screw", loose_parts.loose, HONEST),
    _case("a screw comes loose", loose_parts.loosens, HONEST),
    _case("all lengths grow", trackers.grows, HONEST),
    _case("a supply that sags", transmissions.supply_sags, HONEST),
    _case("a belt across two joints", transmissions.belt_across, HONEST),
    _case("reflections", trackers.line_of_sight, (*QUIET, *HONEST)),
    _case("heavier tails", people.heavy_tails, (*QUIET, "unpredictable")),
    _case("healthy", people.healthy),
    _case("healthy, noise unknown", people.healthy, UNKNOWN, noise_known=False),
    _case("a loose screw, noise unknown", loose_parts.loose, (*UNKNOWN, *HONEST), noise_known=False),
    _case("signs lost in four rows", people.typed_wrongly),
    _case("angles in whole degrees", people.whole_degrees, HONEST),
    _case("load not noted for a third", people.load_forgotten, HONEST),
    _case("target held elsewhere from one pose on", people.other_tool, HONEST),
    _case("positions in half millimetres", people.rounded_positions, (*QUIET, *HONEST)),
    _case("a lens that stretches", trackers.lens, HONEST),
    _case("depth grows with distance", trackers.perspective, HONEST),
    _case("a turntable off its centre", trackers.azimuth_wave, HONEST),
    _case("axes not square", trackers.sheared, HONEST),
    _case("a tripod settles", trackers.creeping_tripod, HONEST),
    _case("a tracker wanders", trackers.wandering, HONEST),
    _case("read before it settled", trackers.late, HONEST),
    _case("noise grows with distance", trackers.noisier_afar, (*QUIET, "unpredictable")),
    _case("play that grows", loose_parts.play_grows, HONEST),
    _case("a servo drifts when loaded", loose_parts.warms_when_loaded, HONEST),
    _case("a bearing sticks", loose_parts.sticks, HONEST),
    _case("plastic remembers loads", loose_parts.creeps, HONEST),
    _case("a cable winds up", loose_parts.cable_winds, HONEST),
    _case("gripper slips under load", loose_parts.tool_slips_under_load, HONEST),
    _case("a belt by another torque", transmissions.belt_by_torque, HONEST),
    _case("pulled by two joints", transmissions.pulled_by_two, HONEST),
    _case("a damaged tooth", transmissions.damaged_tooth, HONEST),
    _case("a soft stop", transmissions.soft_stop, HONEST),
    _case("a servo's table is wrong", transmissions.table_of_the_servo, HONEST),
    _case("the board's clock drifts", transmissions.frequency_drifts, HONEST),
    _case("the board's clock is wrong", transmissions.clock_wrong, HONEST),
    _case("a link that snaps", transmissions.bistable, HONEST),
    _case("a bundle rubs", transmissions.rubs, HONEST),
    _case("angles in whole degrees, noise unknown", people.whole_degrees, (*UNKNOWN, *HONEST), noise_known=False),
)
BLIND_FAULTS = (
    _blind("play where a gear is worn", blind.wears_where_it_works),
    _blind("a servo gives way beyond a torque", blind.gives_way_beyond_a_torque),
    _blind("another marker in one pose of fifteen", blind.another_marker, (*QUIET, *HONEST)),
    _blind("base sinks and is put right", blind.base_sinks_and_is_put_right),
    _blind("rows sorted after a drift", blind.rows_sorted_afterwards),
    _blind("two cameras", blind.two_cameras),
    _blind("a horn that stands off beyond zero", blind.stands_off_beyond_zero),
    _blind("overshoots by a part of the way", blind.overshoots_by_the_way),
    _blind("a servo was replaced", blind.servo_replaced),
    _blind("somebody walks by", blind.somebody_walks_by, (*QUIET, *HONEST)),
    _blind("load written twice as large", blind.load_written_wrongly),
    _blind("a joint follows the square of another", blind.follows_a_square),
)
"""Written down, with what is right for them, after all judgement was set, and run once."""
