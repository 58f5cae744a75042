"""Every simulated world by its key `part/name/poses/seed`, and how it is made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lrm_ident.fitting.cross_validation import FOLDS
from validation.as_deployed.absurd import ABSURD
from validation.as_deployed.board.loop import POSES
from validation.as_deployed.catalogue import CATALOGUE, recording_of
from validation.as_deployed.faults import FAULTS, fault_recording
from validation.as_deployed.leaning import SEEDS, Lean, leaning_recording
from validation.as_deployed.pose_choice import HalfRange
from validation.as_deployed.real_arm import REAL
from validation.as_deployed.recording import WorldRecording

PARTS = ("catalogue", "lean", "beyond", "absurd", "loop", "board", "real")
JOINTS = (2, 3, 4)
COUNTS = (300, 80)


@dataclass(frozen=True)
class SimulatedCase:
    """A world of a part, by name, measured at so many poses, with a seed."""

    part: str
    name: str
    poses: int
    seed: int

    @classmethod
    def of(cls, key: str) -> SimulatedCase:
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
        """The truth, in the tool's words where it has some."""
        if self.part == "lean":
            return Lean.of(self.seed).words
        if self.part == "absurd":
            return ABSURD[self.name].hidden
        if self.name in FAULTS:
            return self.name.partition("/")[2]
        truths = CATALOGUE[self.name].truths
        return "no name fits" if truths is None else " + ".join(" or ".join(sorted(one)) for one in truths) or "nothing"

    def record(self) -> WorldRecording:
        """The simulated world."""
        if self.part == "lean":
            return leaning_recording(self.seed)
        if self.part == "absurd":
            return ABSURD[self.name].record(self.seed)
        if self.name in FAULTS:
            return fault_recording(FAULTS[self.name], self.seed, self.poses)
        if self.part == "beyond":
            return recording_of(CATALOGUE[self.name], self.seed, self.poses, self._half)
        return recording_of(CATALOGUE[self.name], self.seed, self.poses)

    @property
    def _half(self) -> HalfRange:
        """Joints 2, 3 and 4 in turn over cases and seeds, so that seeds 0, 1, 2 give each case every joint."""
        number = [*CATALOGUE].index(self.name)
        return HalfRange(
            JOINTS[(number + self.seed) % len(JOINTS)], -1 if (number // len(JOINTS) + self.seed) % 2 else 1
        )


def cases_of(part: str, seeds: Sequence[int] | None, counts: Sequence[int]) -> Iterator[SimulatedCase]:
    """The cases of a part in their order; seeds: None for those that the part has by itself."""
    if part == "lean":
        yield from (SimulatedCase(part, "lean", Lean.of(seed).poses, seed) for seed in seeds or range(SEEDS))
        return
    if part == "absurd":
        yield from (
            SimulatedCase(part, name, one.poses, seed) for name, one in ABSURD.items() for seed in seeds or (0,)
        )
        return
    names = [*CATALOGUE, *FAULTS] if part == "catalogue" else [*CATALOGUE]
    for count in counts if part == "catalogue" else counts[:1]:
        for seed in seeds or (0,):
            yield from (SimulatedCase(part, name, count, seed) for name in names)


def keys_of(part: str, seeds: Sequence[int] | None, counts: Sequence[int]) -> list[str]:
    """Keys of all cases of a part."""
    if part == "real":
        return [f"{part}/{name}/{FOLDS}/0" for name in REAL]
    if part in ("loop", "board"):
        return [f"{part}/loop/{POSES}/{seed}" for seed in seeds or range(SEEDS)]
    return [one.key for one in cases_of(part, seeds, counts)]


def seed_of(key: str) -> int:
    """Seed of a case's key."""
    return int(key.rpartition("/")[2])
