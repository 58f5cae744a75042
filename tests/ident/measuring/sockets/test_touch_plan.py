"""Planned touches: the arm reaches them as a hand would, they tell more than others, and a command writes them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.table_text.csv_file import read_table
from lrm_ident.measuring.sockets.board import SocketBoard
from lrm_ident.measuring.sockets.touch_plan import TouchPlan, plan_touches, postures
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.model.model import model_of
from tests.support.commands import run_command

pytestmark = pytest.mark.long

ARM, POINTS = load_arm("so101"), SocketBoard().points


@cache
def planned(count: int = 20) -> TouchPlan:
    return plan_touches(ARM, POINTS, count, 3, 0.2e-3)


def test_the_tip_of_the_arm_as_drawn_is_in_each_socket_from_its_open_side() -> None:
    plan, model = planned(), model_of(ARM, ())
    T = frames(model.chain, model.chain.values([*np.ascontiguousarray(plan.q.T)]), len(plan.q))
    for number, (name, stand) in enumerate(zip(plan.points, plan.placement, strict=True)):
        board = plan.placements[stand - 1].motion(POINTS)
        goal = (board @ [*np.array(POINTS[name]) * 1e-3, 1.0])[:3]
        np.testing.assert_allclose(T[number, -1, :3, 3], goal, atol=2e-4)
        assert np.degrees(np.arccos(-T[number, -1, :3, 2] @ board[:3, 2])) < 55.0
        assert T[number, -4:-1, 2, 3].min() > 0.03
    low, high = np.array([(joint.lower, joint.upper) for joint in ARM.joints]).T
    assert np.all((plan.q >= low) & (plan.q <= high))


def test_planned_touches_tell_more_than_random_ones_and_more_touches_more() -> None:
    assert planned().tracker_error < planned().tip_error < planned().random_tip_error
    errors = planned().error_of
    assert [*errors] == [20, 24, 36, 60]
    assert [*errors.values()] == sorted(errors.values(), reverse=True)
    assert errors[20] == pytest.approx(planned().tip_error)
    assert errors[60] < 0.8 * errors[20]
    assert sorted(planned().placement) == list(planned().placement)
    assert {*planned().placement} == {1, 2, 3}


def test_a_socket_out_of_reach_has_no_posture() -> None:
    goals = np.array([[2.0, 0.0, 0.1], [0.2, 0.0, 0.02]])
    found = postures(ARM, goals, np.array([0.0, 0.0, 1.0]), np.random.default_rng(0))
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1]).all()


def test_too_few_touches_and_a_board_out_of_reach_are_refused() -> None:
    with pytest.raises(LrmError, match="15 or more"):
        plan_touches(ARM, POINTS, 12, 3, 0.2e-3)
    with pytest.raises(LrmError, match="smaller board"):
        plan_touches(ARM, {name: np.multiply(4.0, place) for name, place in POINTS.items()}, 20, 3, 0.2e-3)


def test_command_writes_touches_in_the_form_that_fit_reads(tmp_path: Path) -> None:
    assert run_command("sockets", "board", "-o", tmp_path / "board.stl", "--length-mm", 120)[0] == 0
    code, out, _ = run_command("sockets", "plan", "--board", tmp_path / "board.toml", "-o", tmp_path / "plan.csv")
    assert code == 0
    assert "placement 3" in out
    assert "Expected error of the tip" in out
    table = read_table(tmp_path / "plan.csv")
    assert table.header == ("pose", *(f"q{k}_deg" for k in range(1, 6)), "point", "placement")
    assert len(table.rows) == 24
    (tmp_path / "other.toml").write_text('schema = "lrm/measurements/1"\n')
    code, _, said = run_command("sockets", "plan", "--board", tmp_path / "other.toml", "-o", tmp_path / "no.csv")
    assert code == 2
    assert "states no [points]" in said
    assert not (tmp_path / "no.csv").exists()
