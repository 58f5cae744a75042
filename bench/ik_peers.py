"""Inverse kinematics of the same arm by other projects, as their users would call them. Not all need be installed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from bench.peers import Pinocchio
from lrm_math.arm.arm import Arm, JointLimits
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import X, chain_of
from lrm_math.kinematics.screw_axes import screw_axes_of


class PeerSolver(ABC):
    """Another project's solver of one arm. `goals`: how many its success rate is measured on, by its speed."""

    name: str
    goals: int

    @abstractmethod
    def __init__(self, arm: Arm) -> None:
        """Builds its arm. Raises `ImportError` where it is not installed."""

    @abstractmethod
    def solve(self, T: Array) -> Array | None:
        """One answer (n,) to a pose (4, 4), or None."""


class EaikSolver(PeerSolver):
    """EAIK (Ostermeier et al. 2024): all branches by subproblems, in C++; limits are its user's work."""

    name, goals = "EAIK, all branches, then limits", 100_000

    def __init__(self, arm: Arm) -> None:
        from eaik.IK_HP import HPRobot  # type: ignore[import-not-found]

        lines = screw_axes_of(arm)
        offsets = np.vstack([lines.point[:1], np.diff(lines.point, axis=0), lines.position - lines.point[-1]])
        self.robot, self.home = HPRobot(lines.axis.copy(), offsets), np.eye(4)
        self.home[:3, :3] = lines.rotation.T
        limits = JointLimits.of(arm)
        self.lower, self.upper = np.array(limits.lower) - 1e-9, np.array(limits.upper) + 1e-9

    def branches(self, T: Array) -> Array:
        """(M, 6), whatever the limits."""
        return np.asarray(self.robot.IK(T @ self.home).Q)

    def solve(self, T: Array) -> Array | None:
        q = self.branches(T)
        kept = q[((q >= self.lower) & (q <= self.upper)).all(axis=1)]
        return kept[0] if len(kept) else None


class PinocchioLoop(PeerSolver):
    """The closed-loop iteration of pinocchio's own example, damped, from the middle of the limits."""

    name, goals = "pinocchio, CLIK from one start", 2000

    def __init__(self, arm: Arm) -> None:
        built = Pinocchio(arm)
        self.pin, self.robot, self.data, self.tip = built.pin, built.robot, built.data, built.tip

    def solve(self, T: Array) -> Array | None:
        pin, q = self.pin, np.zeros(self.robot.nq)
        target = pin.SE3(T[:3, :3], T[:3, 3])
        for _ in range(200):
            pin.framesForwardKinematics(self.robot, self.data, q)
            error = self.data.oMf[self.tip].actInv(target)
            e = pin.log6(error).vector
            if np.linalg.norm(e) < 1e-10:
                return np.asarray((q + np.pi) % (2 * np.pi) - np.pi)
            J = -pin.Jlog6(error.inverse()) @ pin.computeFrameJacobian(self.robot, self.data, q, self.tip)
            q = q - J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), e)
        return None


class RoboticsToolbox(PeerSolver):
    """The Robotics Toolbox's Levenberg-Marquardt in C++, with its default restarts and limits."""

    name, goals = "roboticstoolbox, ik_LM", 2000

    def __init__(self, arm: Arm) -> None:
        import roboticstoolbox as rtb  # type: ignore[import-not-found]

        ets, ET = rtb.ETS(), rtb.ET
        for slot in chain_of(arm).slots:
            if slot.to_hinge or (slot.nominal == 0.0 and slot.joint is None):
                continue
            axis = "xyz"[slot.axis - X]
            ets = ets * getattr(ET, ("R" if slot.rotates else "t") + axis)(slot.nominal)
            if slot.joint is not None:
                joint = arm.joints[slot.joint]
                ets = ets * ET.Rz(qlim=[joint.lower, joint.upper])
        self.ets = ets

    def solve(self, T: Array) -> Array | None:
        found = self.ets.ik_LM(T, tol=1e-18)
        return np.asarray(found.q) if found.success else None


class IkpySolver(PeerSolver):
    """ikpy: scipy's least squares within bounds, from the middle of the limits."""

    name, goals = "ikpy", 100

    def __init__(self, arm: Arm) -> None:
        from ikpy.chain import Chain  # type: ignore[import-not-found]
        from ikpy.link import OriginLink, URDFLink  # type: ignore[import-not-found]

        lines, before, links = screw_axes_of(arm), np.zeros(3), [OriginLink()]
        for i, joint in enumerate(arm.joints):
            offset, before = lines.point[i] - before, lines.point[i]
            links.append(URDFLink(f"joint{i + 1}", offset, [0, 0, 0], lines.axis[i], bounds=(joint.lower, joint.upper)))
        tool: dict[str, Any] = {"rotation": None, "joint_type": "fixed"}
        links.append(URDFLink("tool", lines.position - before, [0, 0, 0], **tool))
        active = [False] + [True] * arm.dof + [False]
        self.chain, self.home = Chain(links, active_links_mask=active), np.eye(4)
        self.home[:3, :3] = lines.rotation.T

    def solve(self, T: Array) -> Array | None:
        q = self.chain.inverse_kinematics_frame(T @ self.home, orientation_mode="all")
        return np.asarray(q[1:-1])


PEERS: tuple[type[PeerSolver], ...] = (EaikSolver, PinocchioLoop, RoboticsToolbox, IkpySolver)
