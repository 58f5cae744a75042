"""A fetch as a state machine, by behaviours of py_trees and by RAFCON's execution engine, on a daemon in memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lrmd.client import Rover
from lrmd.messages.skills import SkillName
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon
from tests.support.daemon.losing_daemon import LosingDaemon
from tests.support.daemon.skilled_daemon import GOAL, AnsweringDaemon

FETCH: list[tuple[SkillName, dict[str, Any]]] = [
    ("stow", {"q_rad": [0.1] * 6}),
    ("approach", {"goal": GOAL.model_dump(), "height_m": 0.045, "gripper_rad": 0.2}),
    ("touch_down", {"goal": GOAL.model_dump()}),
    ("grasp", {"gripper_rad": -0.1, "payload_kg": 0.03}),
    ("retreat", {"height_m": 0.045}),
    ("carry", {"goal": GOAL.model_dump()}),
    ("drop", {"gripper_rad": 0.2}),
]
TOO_FAR = [FETCH[0], ("stow", {"q_rad": [5.0] * 6}), FETCH[0]]


@pytest.fixture
def daemon() -> Iterator[InMemoryDaemon]:
    daemon = InMemoryDaemon(AnsweringDaemon())
    with daemon.reachable():
        yield daemon


@pytest.fixture
def rover(daemon: InMemoryDaemon) -> Iterator[Rover]:
    with Rover(daemon.sim.config.robot) as rover, rover.control("machine", take=True):
        yield rover


def skills_done(daemon: InMemoryDaemon) -> int:
    core = daemon.sim.core
    report = core.skill_report
    return int(report.number)


@pytest.fixture
def trees() -> Any:
    return pytest.importorskip("py_trees", reason="py_trees is not installed (lrm-skills[py-trees])")


def test_a_fetch_as_a_behaviour_tree(trees: Any, daemon: InMemoryDaemon, rover: Rover) -> None:
    from lrm_skills.behaviours import sequence

    root = sequence(rover, "fetch", FETCH)
    for _ in range(2000):
        root.tick_once()
        if root.status is not trees.common.Status.RUNNING:
            break
    assert root.status is trees.common.Status.SUCCESS
    assert [child.outcome for child in root.children] == ["reached"] * 7
    assert skills_done(daemon) == 7


def test_a_tree_ends_where_a_skill_is_refused(trees: Any, daemon: InMemoryDaemon, rover: Rover) -> None:
    from lrm_skills.behaviours import sequence

    root = sequence(rover, "fetch", TOO_FAR)
    while root.status not in (trees.common.Status.FAILURE, trees.common.Status.SUCCESS):
        root.tick_once()
    assert root.status is trees.common.Status.FAILURE
    assert "outside its limits" in root.children[1].feedback_message
    assert skills_done(daemon) == 2


def test_a_tree_that_is_interrupted_holds_the_arm(trees: Any, daemon: InMemoryDaemon, rover: Rover) -> None:
    from lrm_skills.behaviours import sequence

    root = sequence(rover, "fetch", [("stow", {"q_rad": [1.0] * 6})])
    while daemon.sim.core.mode != "moving":
        root.tick_once()
    root.stop(trees.common.Status.INVALID)
    assert daemon.sim.core.mode == "holding"


@pytest.mark.parametrize("lost", ["rpc/skill", "state/skill"])
def test_a_behaviour_that_knows_nothing_of_its_skill_has_the_arm_hold(trees: Any, lost: str) -> None:
    """Its reply is lost, and the skill begun."""
    from lrm_skills.behaviours import SkillBehaviour

    daemon = LosingDaemon(AnsweringDaemon())
    with daemon.reachable(), Rover(daemon.sim.config.robot) as rover, rover.control("tree", take=True):
        behaviour = SkillBehaviour(rover, "stow", q_rad=[1.0] * 6)
        if lost == "state/skill":
            while daemon.sim.core.mode != "moving":
                behaviour.tick_once()
        daemon.lost = lost
        behaviour.tick_once()
        assert (behaviour.status, behaviour.outcome) == (trees.common.Status.FAILURE, "stopped")
        daemon.sim.run(5)
        there = daemon.sim.ramp.position
        daemon.sim.run(300)
        assert (daemon.sim.core.mode, daemon.sim.ramp.position) == ("holding", there)


def test_a_fetch_as_a_rafcon_state_machine(tmp_path: Path, daemon: InMemoryDaemon, rover: Rover) -> None:
    pytest.importorskip(
        "rafcon.core", reason="rafcon is not installed (pip install --no-deps rafcon, and what its core imports)"
    )
    from rafcon.core.singleton import state_machine_execution_engine as engine
    from rafcon.core.singleton import state_machine_manager

    from lrm_skills.rafcon_library import ENDS, give_rover, machine, write_library

    give_rover(rover)
    for steps, outcome, done in ((FETCH, "success", 7), (TOO_FAR, "ended", 9)):
        made = machine("fetch", steps)
        state_machine_manager.add_state_machine(made)
        engine.start(made.state_machine_id)
        assert engine.join(60)
        assert made.root_state.final_outcome.name == outcome
        assert skills_done(daemon) == done
        state_machine_manager.remove_state_machine(made.state_machine_id)
    for path in write_library(tmp_path):
        saved = (path / "script.py", *path.rglob("script.py"))
        assert any(script.exists() and f"run_skill(self, {path.name!r}" in script.read_text() for script in saved)
    assert "touched_early" in ENDS
