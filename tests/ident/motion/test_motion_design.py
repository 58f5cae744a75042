"""Designed moves: safe by an independent check, told apart what they promise, played as written, read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.measuring.campaign.move_player import play, played_csv, sequence_of
from lrm_ident.measuring.campaign.servo_arm import ServoArm
from lrm_ident.measuring.excitation.excitation_design import Sensitivities, chosen
from lrm_ident.measuring.excitation.excitations import as_moves, offered, ramp_speeds, rules_of
from lrm_ident.measuring.excitation.motion_design import MotionDesign, MotionDesignTask, motion_design
from lrm_ident.measuring.excitation.sequence import MoveSequence, PlayedRow
from lrm_ident.measuring.motion.motion_files import MotionSource
from lrm_ident.measuring.motion.moves import LEAD_S, LONGEST_LEAD_S, between, cut
from lrm_ident.measuring.recordings.command_log import CommandLog, read_command_log
from lrm_math.arm.arm_file import load_arm
from lrm_math.collision.scene import Scene
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.model.reading import AS_NAMED
from lrm_math.motion.motion_model import MotionModel, effect_of
from tests.support.simulated_clock import SimulatedClock
from tests.support.sweep import examples

SO101, ROVER = load_arm("so101"), load_arm("lrm-rover")
NOISE = float(np.radians(0.045))


def task(arm_name: str = "so101", effects: str = "swing@joint2 dead_time@joint2") -> MotionDesignTask:
    arm = load_arm(arm_name)
    rivals = tuple(effect_of(arm, name) for name in effects.split())
    by_tip = arm_name == "lrm-rover"
    return MotionDesignTask(MotionModel.nominal(arm), rivals, 12, 3e-4 if by_tip else NOISE, by_tip)


@pytest.fixture(scope="module")
def design() -> MotionDesign:
    return motion_design(task())


@pytest.mark.long
def test_moves_and_ways_keep_limits_speed_and_table(design: MotionDesign) -> None:
    sequence = design.sequence
    low, high = np.array([(joint.lower, joint.upper) for joint in SO101.joints]).T
    assert (sequence.q > low).all()
    assert (sequence.q < high).all()
    assert sequence.fastest.max() <= np.radians(30.0) * (1.0 + 1e-9)
    chain = chain_of(SO101)
    places = frames(chain, chain.values(list(sequence.q.T)), len(sequence.q))[:, 1:, 2, 3]
    assert places.min() > 0.025  # its table is at z = 0, the rule 0.03


@pytest.mark.slow
def test_rover_keeps_its_distances_and_the_law_of_the_ramp() -> None:
    found = motion_design(task("lrm-rover", "motion_play@joint2 coulomb_friction@joint2")).sequence
    scene = Scene.of(ROVER)
    assert scene.distances(scene.frames(found.q)).min() > 0.0299
    for number, joint in enumerate(ROVER.joints):
        assert joint.servo is not None
        pulses = np.array([joint.servo.pulse_of(q) for q in found.q[:, number].tolist()])
        assert (np.abs(np.diff(pulses)) / np.diff(found.t)).max() <= 1e-6 / 6.5e-3 * (1.0 + 1e-9)


@pytest.mark.long
def test_tells_what_random_moves_do_not(design: MotionDesign) -> None:
    """A delay beside a swing shows in quick starts only; what is promised is what the diagnosis says."""
    assert all(one.told for one in design.pairs)
    late = next(one for one in design.pairs if one.effect == "dead_time@joint2")
    assert late.random < 1.02 < 1.1 < late.designed
    assert {trial.named for trial in design.trials} == {"dead_time@joint2", "swing@joint2"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ("dead_time@joint2", "the only one of joint2"),
        ("dead_time@joint2 dead_time@joint2", "named twice"),
        ("servo_response@joint2 dead_time@joint2", "in the model already"),
        ("sensor_delay@joint2 dead_time@joint2", "no move can show it"),
        ("gravity_sag@joint1 dead_time@joint1", "no safe move can show it"),
    ],
)
def test_refuses_what_no_move_shows(effects: str, words: str) -> None:
    with pytest.raises(LrmError, match=words):
        motion_design(task(effects=effects))


def test_refuses_to_be_faster_than_the_ramp() -> None:
    with pytest.raises(LrmError, match="ramp allows"):
        _ = MotionDesignTask(MotionModel.nominal(ROVER), (), 12, 1e-3, True, speed=1.0).speeds


@examples(10, 20)
@given(st.integers(0, 10_000))
def test_more_moves_never_tell_less(seed: int) -> None:
    """λ of any pair grows with every move: Gram matrices of random columns."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(9, 40, 6))
    known = Sensitivities(np.einsum("sta,stb->sab", X, X), (0, 1), ((2, 3), (4, 5)), np.full(9, 40.0))
    picked = chosen(known, 5)
    assert len(set(picked.tolist())) == 5
    grams = np.cumsum(known.gram[picked], axis=0)
    assert (np.diff(known.noncentrality(grams), axis=0) > -1e-6).all()
    columns = np.concatenate(X[picked])
    span, own = columns[:, [0, 1, 4, 5]], columns[:, 2]
    left = own - span @ np.linalg.lstsq(span, own, rcond=None)[0]
    assert known.noncentrality(grams[-1])[0] == pytest.approx(left @ left, rel=1e-5)


def test_offers_moves_that_begin_and_end_at_rest() -> None:
    offer = offered(SO101, 2, float(ramp_speeds(SO101)[2]), rules_of(SO101), 1)
    moves = as_moves(SO101, offer, NOISE, smooth=False)
    assert len({move.kind for move in offer}) > 5
    assert np.ptp(moves.command[:, :15], axis=1).max() == 0.0
    assert np.ptp(moves.command[:, -8:], axis=1).max() < 1e-9


class Follower:
    """Servos that follow at once. `busy`: s that an answer takes, one of `every` so many."""

    name, joints, step = "follower", tuple(joint.name for joint in SO101.joints), 0.0

    def __init__(self, clock: SimulatedClock, busy: float = 0.0, every: int = 1) -> None:
        self.every, self.asked = every, 0
        self.clock, self.busy, self.told = clock, busy, list[tuple[float, tuple[float, ...]]]()
        self.at: tuple[float, ...] = (0.0,) * 5
        self.heat = 30.0

    def angles(self) -> tuple[float, ...]:
        self.asked += 1
        self.clock.sleep(self.busy if self.asked % self.every == 0 else 0.0)
        return self.at

    def command(self, q: tuple[float, ...]) -> None:
        self.at = tuple(q)
        self.told.append((self.clock.t, self.at))

    def beyond_limits(self, q: object) -> str:
        return ""

    def powered(self) -> dict[str, bool]:
        return dict.fromkeys(self.joints, True)

    def temperature(self) -> dict[str, float]:
        return dict.fromkeys(self.joints, self.heat)

    def settings(self) -> None:
        return None

    def bound_torque(self, share: float) -> None:
        pass

    def forget_late_answers(self) -> None:
        pass


def arm_of(follower: Follower, speed: float = 30.0) -> ServoArm:
    return ServoArm(follower, SO101, follower.clock, lambda _: None, float(np.radians(speed)))  # type: ignore[arg-type]


@pytest.mark.long
@pytest.mark.parametrize(("busy", "every"), [(0.0, 1), (0.05, 1), (0.02, 5), (0.3, 5)])
def test_plays_what_is_written_and_never_faster(design: MotionDesign, tmp_path: Path, busy: float, every: int) -> None:
    path = tmp_path / "moves.csv"
    path.write_text(design.sequence.csv())
    moves, rows, said = sequence_of(read_command_log(path, SO101, AS_NAMED)), list[PlayedRow](), list[str]()
    follower = Follower(SimulatedClock(), busy, every)
    follower.at = tuple((moves.q[0] + 0.2).tolist())
    play(arm_of(follower), moves, rows, said.append)
    assert len(rows) == len(moves.t)
    assert len(said) == 1
    assert np.abs(np.array([row.command for row in rows]) - moves.q).max() < 1e-9
    t, q = np.array([t for t, _ in follower.told]), np.array([q for _, q in follower.told])
    assert (np.abs(np.diff(q, axis=0)).max(axis=1) <= np.radians(30.0) * (np.diff(t) + 1e-4)).all()
    if not busy:
        (tmp_path / "recording.csv").write_text(played_csv(rows))
        read = MotionSource(tmp_path / "recording.csv").moves(SO101)
        assert read.unit == "deg"
        assert len(read) >= 12


def test_rows_left_out_of_a_log_are_told(tmp_path: Path) -> None:
    """Before: `motion fit` and `motion play` cut a row of means below a log, and told nobody."""
    t = np.arange(2400) / 20.0
    q = 20.0 * np.sin(np.outer(t, [0.7, 0.9, 1.1, 1.3, 1.5]))
    tip, dof = np.cumsum(np.ones((2400, 3)), axis=0), range(1, 6)
    names = ["t_s", *(f"q{i}_deg" for i in dof), *(f"q{i}_meas_deg" for i in dof), "x_mm", "y_mm", "z_mm"]
    read = np.vstack([q[:1], q[:-1]])  # a row late
    table = np.column_stack([t, q, read, tip])
    rows = [",".join(f"{cell:.4f}" for cell in row) for row in (*table, table.mean(axis=0))]
    (tmp_path / "log.csv").write_text("\n".join([",".join(names), *rows, ""]))
    said = "line 2402: mean of the rows above, left out"
    assert said in read_command_log(tmp_path / "log.csv", SO101, AS_NAMED).notices
    assert said in MotionSource(tmp_path / "log.csv").moves(SO101).notices


@pytest.mark.long
def test_refuses_before_anything_moves(design: MotionDesign) -> None:
    follower, far = Follower(SimulatedClock()), design.sequence.q.copy()
    with pytest.raises(LrmError, match=r"\w+ stands at 0\.0 deg, the moves begin at .* within 30 deg first"):
        play(arm_of(follower), design.sequence, [], print)
    follower.at = tuple(far[0].tolist())
    with pytest.raises(LrmError, match="within 1 deg"):
        arm_of(follower).follow(MoveSequence(design.sequence.t, far + 0.02), print)
    with pytest.raises(LrmError, match="--speed allows 20 deg/s"):
        play(arm_of(follower, 20.0), design.sequence, [], print)
    assert not follower.told
    follower.heat = 60.0
    with pytest.raises(LrmError, match="is 60"):
        play(arm_of(follower), MoveSequence(design.sequence.t, far), [], print)
    assert not follower.told


@pytest.mark.long
@pytest.mark.parametrize(("number", "words"), [(np.nan, "no number"), (np.inf, "no number"), (4.0, "q2_deg")])
def test_a_log_of_no_numbers_or_beyond_the_limits_is_refused(
    design: MotionDesign, tmp_path: Path, number: float, words: str
) -> None:
    """However they came into the log: an MCAP file may have any."""
    q = design.sequence.q.copy()
    q[7, 1] = number
    with pytest.raises(LrmError, match=words):
        sequence_of(CommandLog(tmp_path / "moves.mcap", SO101, design.sequence.t, q))


def test_a_load_that_grows_evenly_is_that_of_the_middle_of_each_step() -> None:
    t = np.arange(6) / 30.0
    values = np.stack([2.0 * t, 1.0 - t])
    found = between(values, 4)
    middle = (np.arange(20) + 0.5) / 120.0
    np.testing.assert_allclose(found, np.stack([2.0 * middle, 1.0 - middle], axis=1), atol=1e-12)


def test_a_move_begins_where_the_arm_was_slow_before_its_readings_count() -> None:
    dt = 0.1
    unfit = np.ones(200)
    unfit[[60, 75, 120, 137]] = 0.0
    rows, counted = cut(Path("x"), dt, [(unfit, np.arange(200))] * 4)
    first = rows[np.arange(len(rows)), np.argmax(counted, axis=1)]
    leads = first - rows[:, 0]
    assert len({*leads.tolist()}) > 1
    assert np.all((leads >= round(LEAD_S / dt)) & (leads <= round(LONGEST_LEAD_S / dt)))
    half = round(0.5 * LONGEST_LEAD_S / dt)
    assert np.all(leads >= np.minimum(first, half))
    for begin, lead in zip(first, leads, strict=True):
        earlier = unfit[max(begin - 2 * half, 0) : max(begin - half, 0) + 1]
        assert unfit[begin - lead] == earlier.min()
