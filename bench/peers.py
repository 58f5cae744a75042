"""The same computations with pinocchio, with scipy, and without rank-one updates, as their users would write them."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from lrm_ident.data.measurements import Measurements
from lrm_ident.design.observability import observability
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model


class Pinocchio:
    """The arm in pinocchio, every body moving with the joint that carries it."""

    def __init__(self, arm: Arm) -> None:
        import pinocchio as pin

        self.pin, self.robot, place, parent = pin, pin.Model(), self._place(pin, arm.base), 0
        self.robot.gravity.linear = np.array(arm.gravity)
        ends = [(place, place)]
        for i, joint in enumerate(arm.joints):
            turned = place * self._turn(pin, 2, joint.theta)
            parent = self.robot.addJoint(parent, pin.JointModelRZ(), turned, f"joint{i + 1}")
            near = self._shift(pin, joint.a, 0, joint.d) * self._turn(pin, 0, joint.alpha)
            place = near * self._shift(pin, 0, 0, joint.extra_z or 0.0)
            ends.append((near, place))
        t = arm.tool
        turned = place * self._turn(pin, 0, t.alpha) * self._turn(pin, 1, t.beta) * self._turn(pin, 2, t.gamma)
        near, tool = turned * self._shift(pin, t.x, t.y, 0.0), turned * self._shift(pin, t.x, t.y, t.z)
        ends.append((near, tool))
        self.tip = self.robot.addFrame(pin.Frame("tcp", parent, tool, pin.FrameType.OP_FRAME))
        for body in arm.bodies:
            if body.frame > 0:
                inertia = pin.Inertia(body.mass, np.array(body.com), np.zeros((3, 3)))
                stands = ends[body.frame][0 if body.near_end else 1]
                self.robot.appendBodyToJoint(min(body.frame, arm.dof), inertia, stands)
        self.data = self.robot.createData()

    @staticmethod
    def _turn(pin: Any, axis: int, angle: float) -> Any:
        return pin.SE3(pin.AngleAxis(angle, np.eye(3)[axis]).toRotationMatrix(), np.zeros(3))

    @staticmethod
    def _shift(pin: Any, x: float, y: float, z: float) -> Any:
        return pin.SE3(np.eye(3), np.array([x, y, z]))

    def _place(self, pin: Any, b: Any) -> Any:
        turn = self._turn(pin, 0, b.alpha) * self._turn(pin, 1, b.beta) * self._turn(pin, 2, b.gamma)
        return self._shift(pin, b.x, b.y, b.z) * turn

    def tcp(self, q: Array) -> Array:
        """(N, 3), rigid TCP."""
        out = np.empty((len(q), 3))
        for row, angles in enumerate(q):
            self.pin.framesForwardKinematics(self.robot, self.data, angles)
            out[row] = self.data.oMf[self.tip].translation
        return out

    def elastic_tcp(self, q: Array, k: Array, tolerance: float) -> Array:
        """(N, 3), TCP with joint compliances k (n,), by the same fixed point, pose by pose."""
        out = np.empty((len(q), 3))
        for row, angles in enumerate(q):
            bent = angles
            for _ in range(100):
                wanted = angles - k * self.pin.computeGeneralizedGravity(self.robot, self.data, bent)
                change = np.abs(wanted - bent).sum()
                bent = wanted
                if change * 0.5 < tolerance:
                    break
            self.pin.framesForwardKinematics(self.robot, self.data, bent)
            out[row] = self.data.oMf[self.tip].translation
        return out

    def regressors(self, q: Array) -> None:
        """The least that a total Jacobian costs: the kinematic regressor and gravity's derivatives of each pose."""
        pin, world = self.pin, self.pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        last = self.robot.njoints - 1
        for angles in q:
            pin.computeJointJacobians(self.robot, self.data, angles)
            pin.computeJointKinematicRegressor(self.robot, self.data, last, world)
            pin.computeGeneralizedGravityDerivatives(self.robot, self.data, angles)


def scipy_fit(model: Model, data: Measurements, jacobian: bool) -> OptimizeResult:
    """The fit of the free parameters with scipy's least squares, by differences or with our total Jacobian."""
    columns = [model.position(key) for key in model.free]
    scale = np.array([model.parameters[j].typical for j in columns])

    def at(z: Array) -> Model:
        values = model.values.copy()
        values[columns] = z * scale
        return model.with_values(values)

    def residual(z: Array) -> Array:
        return np.asarray((data.tcp - solve_equilibrium(at(z), data.poses).tcp).reshape(-1))

    def derivative(z: Array) -> Array:
        J = parameter_jacobian(solve_equilibrium(at(z), data.poses), model.free)
        return np.asarray(-(J * scale).reshape(-1, len(scale)))

    return least_squares(residual, np.zeros(len(scale)), jac=derivative if jacobian else "2-point", method="trf")


def decomposed_exchange(J: Array, chosen: int) -> tuple[int, int]:
    """One exchange of DETMAX that decomposes every trial set of J (N, 3, P): the pose to add to the first `chosen`, and
    the one to drop."""
    inside, outside = list(range(chosen)), list(range(chosen, len(J)))
    added = max(outside, key=lambda i: observability(J[[*inside, i]]).O1)
    inside.append(added)
    return added, max(inside, key=lambda i: observability(J[[k for k in inside if k != i]]).O1)
