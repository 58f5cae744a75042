"""The catalogue of what goes wrong in a measurement."""

from __future__ import annotations

from functools import partial

from validation.hidden_effects.case import FAULTS, FAULTS_BLIND, Case, of_part
from validation.hidden_effects.faults import loose_parts, people, trackers, transmissions
from validation.hidden_effects.faults.measurement import Fault, GoesOn


def _case(goes_on: GoesOn, name: str, spoil: Fault, noise_known: bool = True) -> Case:
    return Case(name, (), part=FAULTS, spoil=spoil, goes_on=goes_on, noise_known=noise_known)


_over, _arm = partial(_case, GoesOn.NOTHING), partial(_case, GoesOn.ARM)
_frame, _last_frame = partial(_case, GoesOn.FRAME), partial(_case, GoesOn.LAST_FRAME)
FAULT_CASES = (
    _over("a block carries the row before", people.block),
    _over("four pairs of rows swapped", people.swapped),
    _last_frame("tracker moved between sessions", trackers.moved_between),
    _last_frame("tracker moved meanwhile", trackers.moved_meanwhile),
    _last_frame("tracker moved twice", trackers.moved_twice),
    _arm("a joint skipped a tooth", loose_parts.skipped_tooth),
    _arm("the reflector slipped", loose_parts.reflector_slipped),
    _arm("a loose screw", loose_parts.loose),
    _arm("a screw comes loose", loose_parts.loosens),
    _frame("all lengths grow", trackers.grows),
    _arm("a supply that sags", transmissions.supply_sags),
    _arm("a belt across two joints", transmissions.belt_across),
    _over("reflections", trackers.line_of_sight),
    _over("heavier tails", people.heavy_tails),
    _over("healthy", people.healthy),
    _over("healthy, noise unknown", people.healthy, noise_known=False),
    _arm("a loose screw, noise unknown", loose_parts.loose, noise_known=False),
    _over("signs lost in four rows", people.typed_wrongly),
    _over("angles in whole degrees", people.whole_degrees),
    _over("load not noted for a third", people.load_forgotten),
    _arm("target held elsewhere from one pose on", people.other_tool),
    _over("positions in half millimetres", people.rounded_positions),
    _frame("a lens that stretches", trackers.lens),
    _frame("depth grows with distance", trackers.perspective),
    _frame("a turntable off its centre", trackers.azimuth_wave),
    _frame("axes not square", trackers.sheared),
    _frame("a tripod settles", trackers.creeping_tripod),
    _frame("a tracker wanders", trackers.wandering),
    _over("read before it settled", trackers.late),
    _over("noise grows with distance", trackers.noisier_afar),
    _arm("play that grows", loose_parts.play_grows),
    _arm("a servo drifts when loaded", loose_parts.warms_when_loaded),
    _arm("a bearing sticks", loose_parts.sticks),
    _arm("plastic remembers loads", loose_parts.creeps),
    _arm("a cable winds up", loose_parts.cable_winds),
    _arm("gripper slips under load", loose_parts.tool_slips_under_load),
    _arm("a belt by another torque", transmissions.belt_by_torque),
    _arm("pulled by two joints", transmissions.pulled_by_two),
    _arm("a damaged tooth", transmissions.damaged_tooth),
    _arm("a soft stop", transmissions.soft_stop),
    _arm("a servo's table is wrong", transmissions.table_of_the_servo),
    _arm("the board's clock drifts", transmissions.frequency_drifts),
    _arm("the board's clock is wrong", transmissions.clock_wrong),
    _arm("a link that snaps", transmissions.bistable),
    _arm("a bundle rubs", transmissions.rubs),
    _over("angles in whole degrees, noise unknown", people.whole_degrees, noise_known=False),
)
BLIND_FAULTS = tuple(
    of_part(FAULTS_BLIND, case)
    for case in (
        _arm("play where a gear is worn", loose_parts.wears_where_it_works),
        _arm("a servo gives way beyond a torque", loose_parts.gives_way_beyond_a_torque),
        _over("another marker in one pose of fifteen", trackers.another_marker),
        _over("base sinks and is put right", trackers.base_sinks_and_is_put_right),
        _over("rows sorted after a drift", people.rows_sorted_afterwards),
        _frame("two cameras", trackers.two_cameras),
        _arm("a horn that stands off beyond zero", transmissions.stands_off_beyond_zero),
        _arm("overshoots by a part of the way", loose_parts.overshoots_by_the_way),
        _arm("a servo was replaced", loose_parts.servo_replaced),
        _over("somebody walks by", people.somebody_walks_by),
        _arm("load written twice as large", people.load_written_wrongly),
        _arm("a joint follows the square of another", transmissions.follows_a_square),
    )
)
"""Written down, with what is right for them, after all judgement was set, and run once."""
