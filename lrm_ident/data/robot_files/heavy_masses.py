"""Signs that the masses of a robot's file are several times too large; two that agree are evidence.

A link as dense as no metal: a box of its mass and moments of inertia is too small. A joint that its own arm's weight
loads beyond the effort that the file allows it. An arm heavier, for its length, than others are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from lrm_ident.data.robot_files.urdf import Urdf, UrdfJoint
from lrm_math.arm.arm import Arm
from lrm_math.arm.plausible_arm import reach, total_mass
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

DENSEST = 22_600.0  # kg/m³, osmium
USUAL_MOST = 100.0  # kg, of all that moves, per cubed metre of reach, from hobby arms to industrial ones
POSES = 50


def signs_of_heavy_masses(arm: Arm, robot: Urdf, path: Sequence[UrdfJoint]) -> Iterator[str]:
    """Each sign in words. `path`: the joints from base to tip."""
    mass, length = total_mass(arm), reach(arm)
    usual = USUAL_MOST * length**3
    if mass > usual:
        yield f"{mass:.3g} kg move, and an arm of {length:.2g} m usually weighs less than {usual:.2g} kg"
    densities = [link.density for joint in path if (link := robot.links[joint.child]) is not None and link.density]
    if densities and float(np.median(densities)) > DENSEST:
        yield "links of these masses and moments of inertia are denser than any metal"
    yield from _overloaded(arm, [joint for joint in path if joint.commanded])


def _overloaded(arm: Arm, turning: Sequence[UrdfJoint]) -> Iterator[str]:
    """The joint that the arm's weight loads most beyond its effort. Efforts that are all alike are no one's figures."""
    efforts = np.array([joint.effort or math.inf for joint in turning])
    if len(set(efforts.tolist())) < 2:
        return
    lower, upper = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    q = np.random.default_rng(0).uniform(lower, upper, (POSES, arm.dof))
    most = np.abs(solve_equilibrium(model_of(arm, ()), poses_of(q)).joint_torque).max(axis=0)
    worst = int(np.argmax(most / efforts))
    if most[worst] > efforts[worst]:
        effort = f"its <limit effort> of {efforts[worst]:.3g} Nm"
        yield f"the arm's own weight loads {turning[worst].name} with up to {most[worst]:.3g} Nm, more than {effort}"
