"""Places of the task: stones on the ground behind the rover, and the basket on its back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.design.workspace.voxel_grid import Area, default_study, parse_area
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.collision.contact import ContactPermit
from lrm_math.collision.scene import Scene
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import pose
from lrm_math.ik.nominal import NominalSolver
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model import model_of
from lrmd.ik.straight_line import LineEnd, Waypoint, line_path
from lrmd.messages.surroundings import ContactEntry

ARM = "lrm-rover"
HOME = (0.0, -0.5, 0.3, 0.4, 0.0, 0.3)
"""rad: between the ground and the basket, with room on all sides."""
ABOVE_BASKET = 0.08
"""m: from where a stone is dropped."""
RADIUS = 0.012
"""m, of a stone, and the height of its middle, where it is grasped."""
MASSES_G = (5.0, 60.0)
HOVER, REGION = 0.045, 0.035
"""m: height above a stone from which the tool goes straight down; half the width of the place where it may touch."""
TOUCHING = {"fingers": 0.004, "palm": -0.008, "link 6": -0.008}
"""m, depth that is permitted against the ground: the fingers may press, the others only come nearer than the margin."""
SPARE = 0.004
"""m: stones that the arm as drawn reaches with less to spare are not drawn."""
FORCE = 3.0
"""N."""
STEEPEST = np.radians(15.0)
G = 9.81
"""m/s²."""


@dataclass(frozen=True)
class Stone:
    """A stone at a measured `place` (m), of a mass (kg); `tilt`: rotation of the tool that grasps it (3, 3).

    `slope`: of the ground under rover and stone (rad), and which way it leans `towards` (rad).
    """

    place: Array
    mass: float
    tilt: Array
    slope: float = 0.0
    towards: float = 0.0

    @property
    def gravity(self) -> list[float]:
        """m/s², in the frame of a rover that stands on that slope."""
        level = np.array([np.cos(self.towards), np.sin(self.towards)]) * np.sin(self.slope)
        return [float(G * x) for x in (*level, -np.cos(self.slope))]

    def contacts(self) -> list[ContactEntry]:
        """Contacts with the ground that it takes to grasp it, there and only there."""
        low = [self.place[0] - REGION, self.place[1] - REGION, -0.02]
        high = [self.place[0] + REGION, self.place[1] + REGION, HOVER + 0.04]
        return [
            ContactEntry(first=name, second="ground", low_m=low, high_m=high, depth_m=depth, force_n=FORCE)
            for name, depth in TOUCHING.items()
        ]


def areas() -> dict[str, Area]:
    """The author's areas, by name."""
    return {area.name: area for area in map(parse_area, default_study(ARM).areas)}


def stones(count: int, seed: int) -> list[Stone]:
    """Stones in the author's ground area that the arm as drawn can grasp from above.

    Each with a tool that points nearly down; every other one, from the second on, on a slope. Which ones is the same
    whatever the model.
    """
    rng, ground = np.random.default_rng([seed, 63]), areas()["ground"]
    found: list[Stone] = []
    arm = load_arm(ARM)
    drawn = CalibratedSolver.of(model_of(arm, ()))
    solver, plain = NominalSolver.of(arm), Scene.of(arm)
    permits = [ContactPermit(name, "ground", (-1.0,) * 3, (1.0,) * 3, depth) for name, depth in TOUCHING.items()]
    scene = plain.permitting(permits)
    while len(found) < count:
        x, y = rng.uniform(ground.low[:2], ground.high[:2])
        place, mass = np.array([x, y, RADIUS]), float(rng.uniform(*MASSES_G)) * 1e-3
        for yaw in rng.uniform(-np.pi, np.pi, 8):
            tilt = pointing_down(float(yaw), float(rng.uniform(0.0, 0.35)))
            answer = solver.solve_batch(np.array([place, above(place)]), np.array([tilt, tilt]))
            poses = [q[valid] for q, valid in zip(answer.q, answer.valid, strict=True)]
            room = [scene.distances(scene.frames(q)).min(axis=1).max(initial=-1.0) for q in poses]
            if min(room) > scene.margin + SPARE and any(_leads_down(drawn, q, place, tilt) for q in poses[1]):
                found.append(Stone(place, mass, tilt))
                break
    return [replace(stone, slope=s, towards=a) for stone, (s, a) in zip(found, slopes(count, seed), strict=True)]


def slopes(count: int, seed: int) -> list[tuple[float, float]]:
    """Slope and its direction (rad) under each stone: level, and up to the steepest, by turns."""
    rng = np.random.default_rng([seed, 64])
    steep = rng.uniform(0.0, STEEPEST, count) * (np.arange(count) % 2)
    return list(zip(steep.tolist(), rng.uniform(0.0, 2.0 * np.pi, count).tolist(), strict=True))


def basket_pose() -> tuple[Array, Array, Array]:
    """The place above the basket's middle (3,), m, the direction of a tool there (3,), and angles (n,), rad, of the arm
    as drawn near it: of random ones those with the most room."""
    area, arm, rng = areas()["basket"].raised(ABOVE_BASKET), load_arm(ARM), np.random.default_rng(0)
    middle = 0.5 * (np.array(area.low) + np.array(area.high))
    turns = np.linalg.qr(rng.normal(size=(1000, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    answer, scene = NominalSolver.of(arm).solve_batch(np.repeat(middle[None], 1000, axis=0), turns), Scene.of(arm)
    q = answer.q[answer.valid]
    best = q[int(scene.distances(scene.frames(q)).min(axis=1).argmax())]
    return middle, scene.frames(best[None])[0, -1, :3, 2], best


def _leads_down(solver: CalibratedSolver, q: Array, place: Array, tilt: Array) -> bool:
    """Whether a straight line leads from commands (n,), rad, down to a place (m)."""
    x, y, z = place.tolist()
    begin = Waypoint.of(solver, Motion.at(q))
    return not isinstance(line_path(begin, 0.0, pose((x, y, z), tilt), lambda: None), LineEnd)


def above(place: Array) -> Array:
    """(3,), m, from where the tool goes straight down to a place."""
    return np.asarray(place + np.array([0.0, 0.0, HOVER]))


def pointing_down(yaw: float, lean: float) -> Array:
    """(3, 3), a tool whose z axis leans by an angle from straight down, turned about the vertical (rad)."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    k, m = np.cos(lean), np.sin(lean)
    return np.asarray(turn @ np.array([[k, 0.0, m], [0.0, 1.0, 0.0], [-m, 0.0, k]]) @ np.diag([1.0, -1.0, -1.0]))


def quaternion(R: Array) -> list[float]:
    """Unit quaternion x, y, z, w of a rotation matrix (Bar-Itzhack 2000)."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    K = np.array(
        [[a - e - i, d + b, g + c, h - f], [d + b, e - a - i, h + f, c - g], [g + c, h + f, i - a - e, d - b],
         [h - f, c - g, d - b, a + e + i]]
    ) / 3.0  # fmt: skip
    q = np.linalg.eigh(K)[1][:, -1]
    return [float(x) for x in q]
