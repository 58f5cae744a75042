"""A simulated daemon whose client has the lease, for skills, and kinematics that stand in for the ik process."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from lrmd.control.state_machine import Mode
from lrmd.messages.control import ArmRequest, LeaseRequest
from lrmd.messages.kinematics import FkAnswer, FkReply, GoalEntry, IkAnswer, IkReply, KinematicsReply, PlanReply
from lrmd.messages.skills import SkillRequest
from tests.support.daemon.in_memory_daemon import SimulatedDaemon, config_at

GOAL = GoalEntry(position_m=[0.2, 0.0, 0.012])
THERE = [0.8, -0.1, 0.1, 0.0, 0.1, 0.0]
HEADER: dict[str, Any] = {"boot_id": "", "seq": 0, "t_mono_ns": 0, "t_wall_ns": 0, "model": "", "model_sha256": ""}


def reply(question: object, found: bool = True) -> KinematicsReply:
    """The answer of stand-in kinematics, for which every goal is at THERE."""
    common: dict[str, Any] = {**HEADER, "elapsed_ms": 0.0}
    match type(question).__name__:
        case "IkRequest":
            solved: dict[str, Any] = {"verdict": "solved", "q_rad": THERE, "branches_rad": [THERE]}
            answer = solved if found else {"verdict": "out_of_reach"}
            return IkReply(**common, left_out=[], answers=[IkAnswer(**answer, text="words", elapsed_ms=0.0)])
        case "FkRequest":
            place = FkAnswer(tcp_m=[0.2, 0.0, 0.0], rotation=np.eye(3).tolist(), tau_nm=[], sd_m=None)
            return FkReply(**common, left_out=[], places=[place])
    path = [question.from_rad, question.to_rad or THERE]  # type: ignore[attr-defined]
    return PlanReply(**common, found=found, text="words", waypoints_rad=path if found else [])


class SkilledDaemon(SimulatedDaemon):
    """A simulated daemon whose client has the lease, with joints and gripper armed at 0."""

    def __init__(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            super().__init__(config_at(330.0, Path(folder)))
        self.run(30)
        lease = self.core.handle(LeaseRequest(action="acquire", holder="test"), self.now).lease
        self.lease = lease.token
        names = [*self.config.names[:6], "gripper"]
        self.core.handle(ArmRequest(lease=self.lease, where="given", q_rad=dict.fromkeys(names, 0.0)), self.now)
        self.keep(700)
        assert self.core.mode is Mode.ARMED

    def keep(self, ticks: int, answers: bool = False, found: bool = True) -> None:
        for _ in range(ticks):
            if self.ticks % 15 == 0 and self.core.lease is not None:
                self.core.handle(LeaseRequest(action="renew", lease=self.lease), self.now)
            self.tick()
            if answers and (question := self.core.question) is not None:
                self.core.answer(question[0], reply(question[1], found), self.now)

    def begin(self, skill: Any, **fields: Any) -> None:
        self.core.handle(SkillRequest(lease=self.lease, stops=self.core.stops, skill=skill, **fields), self.now)

    @property
    def q(self) -> list[float]:
        return self.core.angles(self.core.position)

    @property
    def outcome(self) -> str:
        return self.core.skill_report.outcome


class AnsweringDaemon(SkilledDaemon):
    """One whose kinematics answer by themselves, in every cycle."""

    def cycle(self) -> None:
        super().cycle()
        if (question := self.core.question) is not None:
            self.core.answer(question[0], reply(question[1]), self.now)
