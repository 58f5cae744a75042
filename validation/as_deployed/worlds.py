"""Every simulated world by its key `part/name/poses/seed`, and how it is made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from lrm_ident.fitting.cross_validation import FOLDS
from validation.as_deployed.catalogue import CATALOGUE, recording_of
from validation.as_deployed.faults import FAULTS, fault_recording
from validation.as_deployed.half_range import HalfRange
from validation.as_deployed.leaning import SEEDS, Lean, leaning_recording
from validation.as_deployed.loop import POSES
from validation.as_deployed.real_arm import REAL
from validation.as_deployed.recording import OngoingWorld, WorldRecording
from validation.hidden_effects.case import Case
from validation.synthetic import load_arm

PARTS = ("catalogue", "lean", "beyond", "loop", "real")
JOINTS = (2, 3, 4)
COUNTS = (300, 80)


def _half_measured(number: int, case: Case) -> OngoingWorld:
    """Joints 2, 3 and 4 in turn over cases and seeds, so that seeds 0, 1, 2 give each case every joint; of an arm with
    fewer joints the last."""

    def record(seed: int, poses: int) -> WorldRecording:
        side = -1 if (number // len(JOINTS) + seed) % 2 else 1
        joint = min(JOINTS[(number + seed) % len(JOINTS)], len(load_arm(case.arm_file).links))
        return recording_of(case, seed, poses, HalfRange(joint, side))

    return OngoingWorld.of(case.truth_words, record)


WORLDS: dict[str, dict[str, OngoingWorld]] = {
    "catalogue": {
        **{name: OngoingWorld.of(case.truth_words, partial(recording_of, case)) for name, case in CATALOGUE.items()},
        **{name: OngoingWorld.of(case.name, partial(fault_recording, case)) for name, case in FAULTS.items()},
    },
    "lean": {"lean": OngoingWorld(lambda seed: Lean.of(seed).words, lambda seed, _: leaning_recording(seed))},
    "beyond": {name: _half_measured(number, case) for number, (name, case) in enumerate(CATALOGUE.items())},
}
"""By part and name."""


@dataclass(frozen=True)
class OngoingCase:
    """A world of a part, by name, measured at so many poses, with a seed; of the real arm poses are folds."""

    part: str
    name: str
    poses: int
    seed: int

    @classmethod
    def of(cls, key: str) -> OngoingCase:
        """The case of a key."""
        part, rest = key.split("/", 1)
        name, poses, seed = rest.rsplit("/", 2)
        return cls(part, name, int(poses), int(seed))

    @property
    def key(self) -> str:
        """`part/name/poses/seed`."""
        return f"{self.part}/{self.name}/{self.poses}/{self.seed}"

    @property
    def hidden(self) -> str:
        """The truth of a simulated world, in the tool's words where it has some."""
        return WORLDS[self.part][self.name].hidden(self.seed)

    def record(self) -> WorldRecording:
        """The simulated world."""
        return WORLDS[self.part][self.name].record(self.seed, self.poses)


def cases_of(part: str, seeds: Sequence[int], counts: Sequence[int]) -> Iterator[OngoingCase]:
    """The cases of a part in their order; without seeds, those that the part has by itself."""
    if part == "real":
        yield from (OngoingCase(part, name, FOLDS, 0) for name in REAL)
    elif part == "lean":
        yield from (OngoingCase(part, part, Lean.of(seed).poses, seed) for seed in seeds or range(SEEDS))
    elif part == "loop":
        yield from (OngoingCase(part, part, POSES, seed) for seed in seeds or range(SEEDS))
    else:
        for count in counts if part == "catalogue" else counts[:1]:
            for seed in seeds or (0,):
                yield from (OngoingCase(part, name, count, seed) for name in WORLDS[part])
