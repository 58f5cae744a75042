"""How far a vehicle with an arm is from tipping over: the force-angle measure (Papadopoulos & Rey 1996), at rest.

About each edge between two neighbouring contacts: the angle by which gravity would have to turn until it points from
the common centre of mass through the edge. The smallest counts; below zero the vehicle tips over.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arm.vehicle import Vehicle
from lrm_math.arrays import Array, Vector3
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.kinematics.statics import weights
from lrm_math.model.equilibrium import Equilibrium


def tip_over_angles(settled: Equilibrium, payload: float, vehicle: Vehicle, gravity: Vector3) -> Array:
    """(N,), rad: of a vehicle with an arm at an elastic equilibrium, with a payload (kg) and under gravity (m/s²)."""
    chain = settled.model.chain
    bodies = weights(chain, payload)
    geometry = chain_geometry(chain, settled.slots, len(settled.tcp), [body.com for body in bodies])
    masses = np.array([body.mass for body in bodies])
    moment = vehicle.mass * np.array(vehicle.com)[:, None] + np.einsum("b,bcn->cn", masses, geometry.body)
    return smallest_edge_angle((moment / (vehicle.mass + masses.sum())).T, vehicle, gravity)


def smallest_edge_angle(com: Array, vehicle: Vehicle, gravity: Vector3) -> Array:
    """(N,), rad, of common centres of mass (N, 3), m."""
    corners, down = np.array(vehicle.contacts), np.array(gravity) / np.linalg.norm(gravity)
    middle, angles = corners.mean(axis=0), []
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        axis = (there - here) / np.linalg.norm(there - here)
        inward = np.cross(axis, down)
        if inward @ (middle - here) < 0.0:
            axis, inward = -axis, -inward
        to_edge = here - com
        to_edge = to_edge - (to_edge @ axis)[:, None] * axis
        across = down - (down @ axis) * axis
        angles.append(np.arctan2(np.cross(to_edge, across) @ axis, to_edge @ across))
    return np.asarray(np.min(angles, axis=0))
