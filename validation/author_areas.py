"""`python -m validation.author_areas`: how many random points of the author's ground and basket areas are solved.

Each point is asked of the daemon's inverse kinematics, with the shipped rover arm as drawn: the orientation free, then
straight down. First as any request, then with the contacts that the fetch permits at that point
(`examples.fetch.places`). The author's ground goes to 10 mm below the surface, so its upper half is asked about, too.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from examples.fetch.places import Stone, areas
from lrm_ident.design.workspace.voxel_grid import Area
from lrm_math.arrays import Array
from lrmd.config import load_config
from lrmd.ik.deployed_model import deploy
from lrmd.ik.service import IkService
from lrmd.messages.kinematics import GoalEntry, IkRequest
from lrmd.messages.surroundings import ContactEntry

CONFIG = Path(__file__).resolve().parents[1] / "config" / "lrmd.toml"
POINTS = 25
DOWN = [0.0, 0.0, -1.0]


def main() -> None:
    """Prints the counts of both areas."""
    parser = argparse.ArgumentParser("python -m validation.author_areas", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    config = replace(load_config(CONFIG), model=None)
    service, rng = IkService.of(config, deploy(config)), np.random.default_rng(options.seed)
    for name, area in areas().items():
        for part, points in parts(name, area, rng):
            for approach in (None, DOWN):
                for permitted in (False, True) if name == "ground" else (False,):
                    counts = Counter(verdict(service, place, approach, permitted) for place in points)
                    how = "tool straight down" if approach else "any orientation"
                    said = ", ".join(f"{count} {what}" for what, count in counts.most_common())
                    print(f"{part} | {how} | {'contacts permitted' if permitted else 'plain'} | {said}", flush=True)


def parts(name: str, area: Area, rng: np.random.Generator) -> list[tuple[str, Array]]:
    """Random points (25, 3), m, of an area; of the ground also of its part above the surface."""
    low, high = np.array(area.low), np.array(area.high)
    found = [(f"{name}, 25 points", rng.uniform(low, high, (POINTS, 3)))]
    if name == "ground":
        surface = np.array([low[0], low[1], 0.0])
        found.append(("ground, 25 points at z = 0 to 10 mm", rng.uniform(surface, high, (POINTS, 3))))
    return found


def verdict(service: IkService, place: Array, approach: list[float] | None, permitted: bool) -> str:
    """What the inverse kinematics says of a place (3,), m."""
    contacts: list[ContactEntry] = Stone(place, 0.02, np.eye(3)).contacts() if permitted else []
    goal = GoalEntry(position_m=place.tolist(), approach=approach)
    (answer,) = service.inverse(IkRequest(goals=[goal], may_touch=contacts))
    return answer.verdict


if __name__ == "__main__":
    main()
