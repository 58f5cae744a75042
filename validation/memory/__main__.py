"""`python -m validation.memory`: what `auto` names in worlds with a memory, and what it leaves."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import lrm_ident as lrm
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.effects.reference import EffectRef
from validation.memory.worlds import ARM, NOISE_M, WORLDS, MemoryWorld, measured, true_parameters
from validation.synthetic import HiddenEffect, write

ALWAYS_TRUE = ("offsets", "compliance")
NEAR = 1.15
TWO_SIDED_95 = 1.959964


@dataclass(frozen=True)
class MemoryOutcome:
    """Outcome of `auto`: classes of its steps, whether each is a finding, the error over the noise, and (estimate −
    truth) / standard error of the hidden cause's parameters."""

    world: MemoryWorld
    steps: tuple[tuple[str, ...], ...]
    findings: tuple[bool, ...]
    ratio: float
    verdict: str
    z: tuple[float, ...] = ()

    @property
    def named(self) -> bool:
        """Whether the first step, or one of its class, is right; without a hidden cause, whether nothing is named."""
        return bool(self.steps and {*self.world.right} & {*self.steps[0]}) if self.world.right else not self.steps

    @property
    def false(self) -> tuple[str, ...]:
        """Identified causes that are none."""
        said = zip(self.steps, self.findings, strict=True)
        return tuple(step[0] for step, finding in said if finding and not {*self.world.right} & {*step})

    @property
    def _figures(self) -> str:
        return f"ratio {self.ratio:.2f}; {self.verdict}; z {' '.join(f'{value:+.1f}' for value in self.z)}"

    @property
    def line(self) -> str:
        """One line."""
        marked = ("named" if self.named else "MISSED") + ("" if not self.false else f" FALSE {', '.join(self.false)}")
        names = " > ".join("=".join(step) for step in self.steps)
        return f"{self.world.name}: {marked}; {names or 'no step'}; {self._figures}"


def run(world: MemoryWorld, seed: int, count: int, folder: Path) -> MemoryOutcome:
    """One world through fit and auto."""
    seen, unseen = measured(world, seed, count)
    data = lrm.load(write(folder / "measured", seen, f"validation.memory, {world.name}")[0], ARM)
    found, _ = lrm.Study.of(data).fit().auto()
    steps = [step for step in found.steps if step.added and EffectRef.parse(step.added).id not in ALWAYS_TRUE]
    shown = [
        one.kind == "finding" for step, one in zip(found.steps[1:], found.attributions, strict=True) if step in steps
    ]
    table, metadata, _ = write(folder / "unseen", unseen, "unseen")
    said = metadata.read_text().replace("noise_sd_mm = 0.0\n", "")  # no measurement may say that it has no noise
    metadata.write_text(said)
    poses = lrm.load_poses(table, ARM)
    settled = lrm.predict(found.model, replace(poses, sha256=None))
    apart = (settled - unseen.tcp_m)[1:]
    ratio = float(np.sqrt((apart**2).sum(axis=1).mean() / (3.0 * NOISE_M**2) + 1.0))
    names = tuple(tuple(step.names) for step in steps)
    z = tuple(_deviations(found.steps[-1].fit, seen.truth.effects))
    return MemoryOutcome(world, names, tuple(shown), ratio, found.verdict, z)


def _deviations(fit: Fit, hidden: Sequence[HiddenEffect]) -> Iterator[float]:
    """(estimate − truth) / standard error of each parameter of the hidden causes that was fitted."""
    for effect in hidden:
        for key, true in true_parameters(effect).items():
            if key in fit.model.free:
                yield (fit.model.value(key) - true) / float(fit.standard_error[fit.model.free.index(key)])


def main() -> None:
    """Runs the worlds and counts."""
    parser = argparse.ArgumentParser(prog="python -m validation.memory", description=__doc__)
    parser.add_argument("--only", default="", help="worlds whose name contains this")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--poses", type=int, default=150)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    outcomes = []
    for seed in range(options.first, options.first + options.seeds):
        for world in WORLDS:
            if options.only in world.name:
                with TemporaryDirectory() as folder:
                    outcomes.append(run(world, seed, options.poses, Path(folder)))
                print(f"{seed} {outcomes[-1].line}", flush=True)
    for words, group in (
        ("written before", [one for one in outcomes if one.world.right and not one.world.later]),
        ("written after", [one for one in outcomes if one.world.right and one.world.later]),
        ("nothing hidden", [one for one in outcomes if not one.world.right]),
    ):
        if group:
            near = sum(one.ratio <= NEAR for one in group)
            false = sum(bool(one.false) for one in group)
            named = sum(one.named for one in group)
            print(
                f"{words}: {len(group)} worlds; right {named}; error within {NEAR} × noise {near}; false names {false}"
            )


if __name__ == "__main__":
    main()
