"""Public touches of two sockets (MUKCa), held out by placements, beside rigid least squares and black boxes.

Nobody measured a position: the two sockets are 50 mm apart, and where the board stood is unknown at every placement. So
the error of a placement that no method has seen is what remains with the board put where that method touches it best.
What is common to a whole placement, the board takes: no method is rewarded or blamed for it.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import lrm_ident as lrm
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.write import write_with_metadata
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.similarity import rigid_motion_between
from lrm_ident.data.robot_files.arm_text import arm_text
from lrm_ident.data.robot_files.mjcf_robot import read_robot
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_math.arrays import Array
from lrm_math.effects.tracker_errors import TouchedPoint
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from validation.real_data.public_touches import DISTANCE_MM, touches
from validation.real_data.rivals import BLACK_BOXES, OURS, RIGID
from validation.real_data.sources import fetched

HOLES = ("hole_0.csv", "hole_1.csv")


@dataclass(frozen=True)
class TouchSource:
    """Touches of one arm in a public repository on GitHub: `path`/PLACEMENT/hole_K.csv, and the arm's URDF.

    Attributes:
        repository: owner/name. commit, licence, author: of the data. tip: link of the ball in the URDF.
    """

    repository: str
    path: str
    placements: tuple[str, ...]
    urdf: str
    tip: str
    commit: str
    licence: str
    author: str

    def held_out(self, mirror: Path | None, most: int | None) -> dict[str, float]:
        """RMS distance (m) of every method at placements that it never saw. Raises `NotReachable`.

        `most`: of the touches of each socket at a placement.
        """
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            (folder / "arm.urdf").write_text(fetched(self.repository, self.commit, self.urdf, mirror))
            robot = import_arm(read_robot(folder / "arm.urdf"), None, self.tip)
            (folder / "arm.toml").write_text(arm_text(robot.arm, self.urdf))
            for name in (f"{placement}/{hole}" for placement in self.placements for hole in HOLES):
                (folder / name).parent.mkdir(exist_ok=True)
                rows = fetched(self.repository, self.commit, f"{self.path}/{name}", mirror).splitlines()[:most]
                (folder / name).write_text("\n".join(rows) + "\n")
            left: dict[str, list[Array]] = {}
            for known, unseen in self._parts(folder):
                for method, beside in errors(known, unseen).items():
                    left.setdefault(method, []).append(beside)
        every = {method: np.concatenate(parts) for method, parts in left.items()}
        return {method: error_stats(error).rms for method, error in every.items()}

    def _parts(self, folder: Path) -> Iterator[tuple[Measurements, Measurements]]:
        """Touches that are known and that are predicted, for each placement."""
        for placement in self.placements:
            others = [name for name in self.placements if name != placement]
            yield self._loaded(folder, others), self._loaded(folder, [placement])

    def _loaded(self, folder: Path, placements: Sequence[str]) -> Measurements:
        path, text = folder / "touches.csv", touches(folder, [*placements])
        path.unlink(missing_ok=True)
        path.with_suffix(".toml").unlink(missing_ok=True)
        write_with_metadata(path, text, "arm.toml", self.repository, distances={"hole_0-hole_1": DISTANCE_MM})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that the places of the boards are found with the arm
            return lrm.load(path, arm=folder / "arm.toml")


def errors(known: Measurements, unseen: Measurements) -> dict[str, Array]:
    """(N, 3), m, of unseen touches beside their sockets, by method; each learns from the known ones."""
    drawn, fits = lrm.Study.of(unseen, "offsets").model, {}
    for name, effects in ((RIGID, "offsets"), (OURS, "offsets,compliance")):
        fits[name] = lrm.Study.of(known, effects).fit().model
    rigid = fits[RIGID]
    at, rest = tips(rigid, unseen), beside_sockets(tips(rigid, known), known)
    found = {"as drawn": tips(drawn, unseen), RIGID: at}
    for name, learn in BLACK_BOXES.items():
        found[name] = at - learn(known.poses.q, rest, unseen.poses.q)
    found[OURS] = tips(fits[OURS], unseen)
    return {name: beside_sockets(tip, unseen) for name, tip in found.items()}


def tips(model: Model, data: Measurements) -> Array:
    """(N, 3), m, where a model's arm has its tip, wherever the boards stood."""
    kept = [effect for effect in model.effects if not isinstance(effect, TouchedPoint)]
    values = {key: model.value(key) for effect in kept for key in effect.keys}
    return solve_equilibrium(model_of(model.arm, kept, values), data.poses).tcp


def beside_sockets(tip: Array, data: Measurements) -> Array:
    """(N, 3), m, of the tips beside their sockets, with each board put where it is touched best."""
    out = np.empty_like(tip)
    for number, frame in enumerate(data.touched, start=1):
        rows = data.poses.placement == number
        motion = rigid_motion_between(data.tcp[rows], tip[rows], frame.turns)
        out[rows] = tip[rows] - motion.apply(data.tcp[rows])
    return out
