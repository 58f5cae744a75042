"""The story of a model: how far the error fell from the nominal arm, by what, and what it is where the model is used.

Terminal, page, report, notebook and figure show this one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

from lrm_ident.data.wording import UNSEEN, in_mm
from lrm_ident.report.document import BAR, ResultTable
from lrm_ident.report.plain_names import step_title
from lrm_ident.report.text.claims import chosen_again
from lrm_math.arm.arm_file import MM
from lrm_math.effects import EffectRef
from lrm_math.effects.targets import FRAME_PLACE
from lrm_math.model.model_file import AttributionTerm, CourseTable, HistoryTable, ModelFile

Kind = Literal["nominal", "fit", "effect", "end"] | AttributionTerm
"""What made the error fall; "effect": added, and what it shows is not known; "end": an error beside the last step's."""
WITHOUT_EFFECT = ("nominal", "fit")
"""What adds no effect: the nominal arm, the first fit, and later ones without outliers or with a prior."""
GEOMETRY = "lengths, angles and stiffness fitted"
NESTED = "nested, effects chosen anew"
NOISE, NOISE_AT_MOST = "measurement noise", "measurement noise, at most"
BAR_WIDTH = 8
TORN, ROOM = 2.2, 1.4
"""How much longer than all others a bar of a waterfall is cut short, and its length beside these then."""
BY_THE_TRACKER = "as this tracker measures it: its own error is in this figure, and not in the deployed model"
ON_THE_ARM = "expected on the arm after this session"
ANEW = "with the effects, too, chosen without these poses"


@dataclass(frozen=True)
class StoryStep:
    """One fall of the error.

    Attributes:
        title: in plain words. kind: what made it fall. number: of the step in the history; None of the nominal arm.
        before_rms_mm, rms_mm: RMS error before and after it. deployed_rms_mm: after it, as deployed; None: not known.
        deployed_poses: number of poses that this one is of; None: of all. deployed_95_mm: its 95 % interval, if known.
    """

    title: str
    kind: Kind
    number: int | None
    before_rms_mm: float
    rms_mm: float
    deployed_rms_mm: float | None = None
    deployed_poses: int | None = None
    deployed_95_mm: Sequence[float] | None = None

    @property
    def explained(self) -> float:
        """Mean square (mm²) that was taken away."""
        return self.before_rms_mm**2 - self.rms_mm**2

    @property
    def left(self) -> str:
        """The error that is left, as it is printed."""
        return in_mm(self.rms_mm * MM)


@dataclass(frozen=True)
class Story:
    """How the error fell.

    Attributes:
        steps: of the nominal arm, of every fit, of every effect that was added.
        held_out: whether the errors are held out (of the nominal arm nothing was fitted), else on these data.
        nested_rms_mm, nested_deployed_rms_mm: held out with the effects chosen anew in every fold;
        nested_deployed_poses: number of poses that the second is of, None: of all.
        chosen_in_folds, folds: how many of the folds chose each effect anew.
        of_tracker: whether an error of the tracker was added.
        noise_rms_mm: of the measurement; noise_bound_rms_mm: where that is not known, what it is at most.
    """

    steps: tuple[StoryStep, ...]
    held_out: bool
    nested_rms_mm: float | None = None
    nested_deployed_rms_mm: float | None = None
    noise_rms_mm: float | None = None
    noise_bound_rms_mm: float | None = None
    of_tracker: bool = False
    chosen_in_folds: Mapping[str, int] = field(default_factory=dict)
    folds: int = 0
    nested_deployed_poses: int | None = None

    @property
    def later(self) -> tuple[StoryStep, ...]:
        """The steps after the first fit."""
        return self.steps[2:]

    @property
    def sentence(self) -> str:
        """The whole course in one line."""
        added = [step for step in self.steps if step.kind not in WITHOUT_EFFECT]
        start = self.steps[: self.steps.index(added[0])] if added else self.steps
        errors = [f"{step.title} {step.left}" for step in start]
        if added:
            errors.append(f"{_counted(added)} {self.steps[-1].left}")
        return f"{' → '.join(errors)} mm RMS{f' {UNSEEN}' if self.held_out else ''}"

    @property
    def _between(self) -> str:
        """The 95 % interval of the last error as deployed, in brackets; empty where it is not known."""
        between = self.steps[-1].deployed_95_mm
        return "" if between is None else f" ({' to '.join(in_mm(end * MM) for end in between)}, 95 %)"

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """What else is known of the last error, labelled."""
        on_arm = self.nested_deployed_rms_mm
        there = "" if on_arm is None else f"; as deployed {in_mm(on_arm * MM)} mm{at_poses(self.nested_deployed_poses)}"
        more = "" if _alike(on_arm, self.nested_rms_mm) else there
        part = at_poses(self.steps[-1].deployed_poses)
        after = {
            "as deployed": f"{self._between}{part} {BY_THE_TRACKER if self.of_tracker else ON_THE_ARM}",
            NESTED: f", {ANEW}{more}",
            NOISE: "",
            NOISE_AT_MOST: " at most",
        }
        rows = (*self.ends, *([self.noise] if self.noise else []))
        return tuple((row.title.partition(",")[0], f"{row.left} mm RMS{after[row.title]}") for row in rows)

    @property
    def ends(self) -> tuple[StoryStep, ...]:
        """Errors below the steps of a waterfall: as deployed, where that is another than the last one; nested."""
        last = self.steps[-1]
        deployed = None if _alike(last.deployed_rms_mm, last.rms_mm) else last.deployed_rms_mm
        known = ("as deployed", deployed), (NESTED, self.nested_rms_mm)
        return tuple(StoryStep(title, "end", None, mm, mm) for title, mm in known if mm)

    @property
    def noise(self) -> StoryStep | None:
        """Noise of the measurement, or what it is at most, where one of them is known."""
        known = (NOISE, self.noise_rms_mm), (NOISE_AT_MOST, self.noise_bound_rms_mm)
        return next((StoryStep(title, "end", None, mm, mm) for title, mm in known if mm), None)

    @property
    def longest(self) -> float:
        """Error (mm) of the longest bar of a waterfall, which ends a longer one."""
        nominal, *later = (step.rms_mm for step in (*self.steps, *self.ends))
        most = max(later, default=0.0)
        return ROOM * most if most and nominal > TORN * most else max(nominal, most)

    @property
    def certainty(self) -> tuple[tuple[str, str], ...]:
        """How often the effects were chosen again, labelled; empty where no cross-validation chose them anew."""
        return (("chosen again", chosen_again(self.chosen_in_folds, self.folds)),) if self.folds else ()

    def table(self) -> ResultTable:
        """The steps, the error of the fit with the longest bar: beside that of the nominal arm the others are dots."""
        most = max((step.rms_mm for step in self.steps[1:] or self.steps), default=1.0)
        rows = [
            (
                step.title,
                "" if step.kind in (*WITHOUT_EFFECT, "effect") else step.kind,
                step.left,
                None
                if step.deployed_rms_mm is None
                else f"{in_mm(step.deployed_rms_mm * MM)}{at_poses(step.deployed_poses)}",
                BAR * round(BAR_WIDTH * step.rms_mm / most) if number else "",
            )
            for number, step in enumerate(self.steps)
        ]
        error = "held-out RMS, mm|" if self.held_out else "RMS, mm|"
        return ResultTable(("step", "what it is", error, "as deployed|", ""), rows, "How the error fell")

    def showing(self, kinds: Mapping[int, Kind]) -> Self:
        """The same with what steps are, by their number, where a diagnosis says it."""
        steps = (replace(step, kind=kinds.get(step.number or 0, step.kind)) for step in self.steps)
        return replace(self, steps=tuple(steps))

    def as_json(self) -> dict[str, object]:
        """The table `story`."""
        return {"sentence": self.sentence, **vars(self)}


def story_of_file(file: ModelFile) -> Story | None:
    """The story that a model file tells of its own data; None where it has no history, or no nominal error."""
    if not file.history or file.history[0].nominal_rms_mm is None:
        return None
    hashes = {None if entry.provenance is None else entry.provenance.data_sha256 for entry in file.history}
    held = [entry.held_out_rms_mm if len(hashes) == 1 else None for entry in file.history]
    return story_of(file.history, held, [entry.fit_rms_mm for entry in file.history], file.history[0].nominal_rms_mm)


def story_of(
    history: Sequence[HistoryTable],
    held_out_mm: Sequence[float | None],
    here_mm: Sequence[float],
    nominal_mm: float,
    noise_mm: float | None = None,
    bound_mm: float | None = None,
) -> Story:
    """A story; what its steps are is as the file says.

    Args:
        held_out_mm: RMS error after each step at poses that no fit has seen. here_mm: on these data; told where one of
            those is not known.
    """
    course = history[-1].course or CourseTable()
    held = [error for error in held_out_mm if error is not None]
    held_out = len(held) == len(history)
    steps = [StoryStep("nominal", "nominal", None, nominal_mm, nominal_mm)]
    for number, (entry, error_of_step) in enumerate(zip(history, held if held_out else here_mm, strict=True)):
        kind: Kind = course.shows.get(entry.name.added) or "effect"
        title = step_title(entry.name) if number else GEOMETRY
        deployed = entry.deployed_rms_mm if held_out else None
        made = kind if number and entry.name.added else "fit"
        poses = None if deployed is None else entry.deployed_poses
        between = None if deployed is None else entry.deployed_95_mm
        steps.append(StoryStep(title, made, number, steps[-1].rms_mm, error_of_step, deployed, poses, between))
    noise = noise_mm if noise_mm is not None else course.noise_rms_mm
    nested = course.nested_rms_mm, course.nested_deployed_rms_mm
    names = [entry.name.added for entry in history if entry.name.added]
    of_tracker = any(EffectRef.parse(name).place == FRAME_PLACE for name in names)
    chosen = course.chosen_in_folds, course.folds
    return Story(tuple(steps), held_out, *nested, noise, bound_mm, of_tracker, *chosen, course.nested_deployed_poses)


def at_poses(count: int | None) -> str:
    """How many poses an error as deployed is of, where they are not all (None): it is not that of other steps."""
    return "" if count is None else f" at {count} poses"


def _alike(first: float | None, other: float | None) -> bool:
    """Whether two errors (mm) are the same as they are printed: then one of them is enough."""
    return first is not None and other is not None and in_mm(first * MM) == in_mm(other * MM)


def _counted(steps: Sequence[StoryStep]) -> str:
    """Steps by what they are, `with 1 identified cause and 2 empirical terms:`; one identified cause by its name."""
    if [step.kind for step in steps] == ["identified cause"]:
        return f"with {steps[0].title}:"
    counts = Counter(step.kind for step in steps)
    *words, last = [f"{count} {kind}{'s' if count > 1 else ''}" for kind, count in counts.items()]
    return f"with {', '.join(words)}{' and ' if words else ''}{last}:"
