"""Model files: the effects of an arm and their parameters, read by the daemon and the offline tool."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, model_validator

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_digest import WHAT_COUNTS, arm_sha256
from lrm_math.arm.arm_file import arm_of
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.effects import CATALOGUE, Effect, EffectRef, ModelPart, Parameter, ParameterRef, effect_names, effects_at
from lrm_math.effects.compliance import SPRINGS
from lrm_math.effects.measured_range import MeasuredRange, UnmeasuredAngles
from lrm_math.effects.memory.effect_with_memory import EffectWithMemory
from lrm_math.effects.offsets import Offsets
from lrm_math.effects.reversion import Reversion
from lrm_math.effects.servo_errors import ServoGain
from lrm_math.effects.session_errors import warms_with_the_arm
from lrm_math.effects.targets import FRAME_PLACE
from lrm_math.effects.tracker_errors import MeasurementFrame
from lrm_math.errors import FileError, LrmError, UnknownName
from lrm_math.model.covariance import Covariance, CovarianceTable, to_covariance
from lrm_math.model.model import Model, model_of
from lrm_math.model.reading import Reading
from lrm_math.model.session_state import CarriedState, SessionMemory, StateAfterSession
from lrm_math.model.step_name import StepName
from lrm_math.toml_file import StrictSchema, read_toml

SCHEMA: Final = "lrm/model/2"
VERSION_1 = "lrm/model/1"
MOST_EFFECTS = 1000
MOST_ANGLES = 1000
FIT_AGAIN = "take the arm file of the fit, or fit again (lrm-ident fit --start)"
PartsTable: TypeAlias = dict[Literal["arm", "installation", "measurement"], list[str]]
TRACKER_FRAME = EffectRef(MeasurementFrame.id, FRAME_PLACE)
"""Beginning of keys of older files."""
Ends: TypeAlias = Annotated[list[float], Field(min_length=2, max_length=2)]


class ProvenanceTable(StrictSchema):
    """Table `[provenance]`: data, tool and date of the fit; and the file of the user's own effects, if it has any.

    `poses`: how many were fitted. `left_out`: numbers of those that were not. `arm_sha256`: of the arm (`arm_sha256`).
    `servos`: settings of the servos that were measured with, by joint.
    """

    data: str
    data_sha256: str
    arm_sha256: str | None = None
    poses: int
    tool: str
    date: str
    loss: str = "squared"
    prior: str | None = None
    left_out: list[int] = []
    effects_file: str | None = None
    effects_sha256: str | None = None
    reading: Reading | None = None
    servos: ServoSettings | None = None


class ReversionTable(StrictSchema):
    """Table `[range.reversion]`: beyond an angle of a joint the model goes back to that without some empirical terms.

    `terms`: these effects, `id@place`. `below_deg`, `above_deg`: angles beyond which they hold less and less, by joint.
    `changes`: what is added to parameters far beyond, by their keys, in the keys' units.
    """

    terms: Annotated[list[str], Field(min_length=1)]
    below_deg: dict[str, float] = {}
    above_deg: dict[str, float] = {}
    changes: dict[str, float] = {}


class RangeTable(StrictSchema):
    """Table `[range]`, lowest and highest value of what was fitted: joints' commands, loads on slots by key and unit
    (`joint2.theta_Nm`, `joint3.d_N`), times, the TCP's x, y and z. Beyond it curves stay as at its edge; without it
    they go on by formula. `centre_mm`: mean of the TCP's positions, about which a tracker's frame distorts; without it,
    in older files, that is about the base's origin. `measured_deg`: angles at which each joint was measured;
    `open_deg`: standard deviation of each joint's error far from these (`UnmeasuredAngles`). `candidates`: effects
    (`id@place`) that were added and are no identified causes: what they say beyond the range may be wrong.
    """

    joints_deg: list[Ends]
    payload_g: Ends
    t_s: Ends | None = None
    running_s: Ends | None = None
    tcp_mm: Annotated[list[Ends], Field(min_length=3, max_length=3)] | None = None
    centre_mm: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    measured_deg: list[Annotated[list[float], Field(min_length=1, max_length=MOST_ANGLES)]] | None = None
    open_deg: list[Annotated[float, Field(ge=0.0)]] | None = None
    loads: dict[str, Ends] = {}
    reversion: ReversionTable | None = None
    candidates: list[str] | None = None


class MemoryTable(StrictSchema):
    """Table `[deployed.memory.EFFECT]`: memory of an effect in its session.

    `offsets`: what of those of `[deployed]` stands for it, in the same units. `mean`, `sd`: of the numbers that the
    effect remembers, in SI (loads in N·m, squared ones in N²m², shares): of an arm of which nothing is known.
    """

    offsets: dict[str, float] = {}
    mean: list[float]
    sd: list[Annotated[float, Field(ge=0)]]


class DeployedTable(StrictSchema):
    """Table `[deployed]`: state that effects of a session leave behind, for where the model is used later.

    `carried`: of each effect `id@place`, whether its last or its mean state. `offsets`: what is added to constant
    offsets, springs and gains, by their keys, in the keys' units. `warming_rad`: drifts of joints that follow the time
    since power-on where it is known, each with the part of its joint's offset that it replaces then. `memory`: of each
    effect that follows what the arm did before, where that is known.
    """

    carried: dict[str, CarriedState] = {}
    offsets: dict[str, float] = {}
    warming_rad: dict[str, float] | None = None
    memory: dict[str, MemoryTable] | None = None


RIVALS_1 = ", or ", ": these data cannot tell"
"""What stood around the names of indistinguishable effects in the steps of older files of `lrm/model/1`."""


AttributionTerm: TypeAlias = Literal["identified cause", "indistinguishable cause", "candidate cause", "empirical term"]
"""What an added effect is, in the words that people and files read (`lrm_ident.diagnosis.attribution`)."""


class CourseTable(StrictSchema):
    """Table `[history.course]`: what is known once all steps up to this one were taken.

    `shows`: what each effect that was added is, by its name. `noise_rms_mm`: of the measurement. `nested_rms_mm`,
    `nested_deployed_rms_mm`: held out with the effects chosen anew in every fold, and the same as deployed, of
    `nested_deployed_poses` where those are not all.
    `chosen_in_folds`: number of these `folds` that chose each effect.
    """

    shows: dict[str, AttributionTerm] = {}
    noise_rms_mm: float | None = None
    nested_rms_mm: float | None = None
    nested_deployed_rms_mm: float | None = None
    nested_deployed_poses: int | None = None
    chosen_in_folds: dict[str, int] = {}
    folds: int = 0


class HistoryTable(StrictSchema):
    """One `[[history]]` entry: a step, its errors, and the whole model after it.

    `step`: `fit`, `add`, `refit`, `leave_out`, `free` or `transfer`; `of`: the effect that was added, the prior, the
    bench (`StepName`).
    `nominal_rms_mm`: error of the nominal arm on the same data, of a fit.
    `deployed_rms_mm`: held-out error of the model as it is deployed, without what no rover can know;
    `deployed_95_mm`: its 95 % interval at other poses like these, while the arm stays as it is; `deployed_poses`: the
    number of poses that it is of, where those are not all of the step's.
    `indistinguishable`: effects (`id@place`) that these poses could not distinguish from the one that was added.
    `rivals_mm`: the held-out RMS that other effects alone would have left, the least first; None: not known.
    `rivals_refitted`: those of them that were refitted; of the others it is an estimate of the linear screening.
    """

    step: str
    of: str = ""
    indistinguishable: list[str] = []
    nominal_rms_mm: float | None = None
    fit_rms_mm: float
    held_out_rms_mm: float | None = None
    deployed_rms_mm: float | None = None
    deployed_95_mm: Ends | None = None
    deployed_poses: int | None = None
    rivals_mm: dict[str, float] | None = None
    rivals_refitted: list[str] = []
    effects: list[str]
    parameters: dict[str, float]
    sigma: dict[str, float] = {}
    covariance: CovarianceTable | None = None
    range: RangeTable | None = None
    deployed: DeployedTable | None = None
    parts: PartsTable = {}
    provenance: ProvenanceTable | None = None
    course: CourseTable | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_version_1(cls, table: object) -> object:
        """`lrm/model/1` had what a step was taken of in its name, and until November 2026 its rivals too."""
        if not isinstance(table, dict) or "of" in table or not isinstance(written := table.get("step"), str):
            return table
        kind, of = StepName.of_version_1(written)
        beside = written.partition(RIVALS_1[0])[2]
        named = [name.split(" and ")[0] for name in beside.removesuffix(RIVALS_1[1]).split(", ") if name]
        return {"indistinguishable": named, **table, "step": kind, "of": of}

    @property
    def name(self) -> StepName:
        """What the step did."""
        return StepName(self.step, self.of)


class ModelFile(StrictSchema):
    """The whole file, schema `lrm/model/2`; `lrm/model/1` is read, too.

    `[parameters]` holds the fitted ones; others are zero.
    `parts`: the effects of arm, installation and measurement, for the reader: the effects themselves say it.
    """

    schema_: Literal["lrm/model/2", "lrm/model/1"] = Field(alias="schema")
    arm: str
    effects: Annotated[list[str], Field(max_length=MOST_EFFECTS)]
    parameters: dict[str, float] = {}
    sigma: dict[str, float] = {}
    covariance: CovarianceTable | None = None
    range: RangeTable | None = None
    deployed: DeployedTable | None = None
    parts: PartsTable = {}
    history: list[HistoryTable] = []
    provenance: ProvenanceTable | None = None

    @property
    def residual(self) -> float:
        """RMS distance (m) of the measured TCP from the model at the poses of its last fit; 0 where it is not known."""
        return self.history[-1].fit_rms_mm * 1e-3 if self.history else 0.0

    @model_validator(mode="before")
    @classmethod
    def _of_version_1(cls, table: object) -> object:
        """Its tables are those of this version, but for the names of steps (`HistoryTable`)."""
        if not isinstance(table, dict) or table.get("schema") != VERSION_1:
            return table
        return {**table, "schema": SCHEMA}


def load_model(file: str | Path, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Model:
    """The model of one file, its parameters free.

    Raises:
        FileError: the file, its arm, an effect or a parameter is not valid; or the arm is another than that of the fit.
    """
    path = Path(file)
    tables = read_toml(path, ModelFile)
    arm = arm_of(path, tables.arm)
    if words := arm_mismatch(tables, arm):
        raise FileError(path, "arm", words, FIT_AGAIN)
    return to_model(path, tables, arm, catalogue)


def settings_of_model(file: str | Path) -> ServoSettings | None:
    """Settings of the servos that a model was measured with; None: not known. Raises `FileError`."""
    provenance = read_toml(Path(file), ModelFile).provenance
    return None if provenance is None else provenance.servos


def load_covariance(path: Path, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Covariance | None:
    """Covariance of the parameters of a file's model (SI), or None if the file has none.

    Raises:
        FileError: as `load_model`, or a `[covariance]` that contradicts itself.
    """
    tables = read_toml(path, ModelFile)
    return covariance_of(path, tables, to_model(path, tables, arm_of(path, tables.arm), catalogue))


def covariance_of(path: Path, tables: ModelFile, model: Model) -> Covariance | None:
    """Covariance of the parameters of parsed tables' model (SI), None without one. Raises `FileError`."""
    if tables.covariance is None:
        return None
    try:
        return to_covariance(tables.covariance, tables.sigma, model)
    except LrmError as error:
        raise FileError(path, "covariance", str(error)) from None


def arm_mismatch(tables: ModelFile, arm: Arm) -> str:
    """Words for an arm that is not the one of the fit, whatever it is called; none if it is, or nobody knows."""
    arm_hash = None if tables.provenance is None else tables.provenance.arm_sha256
    if arm_hash in (None, arm_sha256(arm)):
        return ""
    return f"{arm.name} is not as it was when the model was fitted: {WHAT_COUNTS} differ"


def _turns_a_tracker(key: str) -> bool:
    reference = ParameterRef.parse(key)
    return reference.effect == TRACKER_FRAME and reference.name.startswith("turn_")


def to_model(path: Path, tables: ModelFile, arm: Arm, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Model:
    """The model of parsed tables, in SI. Raises `FileError`."""
    where = "effects"
    if turned := next(filter(_turns_a_tracker, tables.parameters), None):
        what = f"{turned}: a tracker's frame no longer turns, since that is the base's"
        raise FileError(path, "parameters", what, "fit again, from the measurements")
    if twice := next((name for name, times in Counter(tables.effects).items() if times > 1), None):
        raise FileError(path, where, f"{twice} is named twice", "name each effect once")
    try:
        effects = [effect for name in tables.effects for effect in effects_at(arm, name, catalogue)]
        where = "parameters"
        empty = model_of(arm, effects)
        values = {key: value * empty.parameter(key).si for key, value in tables.parameters.items()}
        where = "sigma"
        for key in tables.sigma:
            empty.position(key)
        model = model_of(arm, effects, values)
    except LrmError as error:
        raise FileError(path, where, str(error), _own_effects(tables) if where == "effects" else "") from None
    shape = {key for key, parameter in zip(model.keys, model.parameters, strict=True) if parameter.fixed is not None}
    free = tuple(key for key in model.keys if key in values and key not in shape)
    data_hash = None if tables.provenance is None else tables.provenance.data_sha256
    within, state = _range_of(path, tables.range, model), _state_of(path, tables.deployed, model)
    return replace(model, free=free, within=within, fitted_to=data_hash, state=state)


def _state_of(path: Path, table: DeployedTable | None, model: Model) -> StateAfterSession | None:
    """The state of a file's session effects (SI).

    Raises `FileError`: an effect or an offset that is not there, or an effect that does not follow the time.
    """
    if table is None:
        return None
    names, every = [effect.name for effect in model.effects], _offsets(model.arm)
    laws = [effect.name for effect in model.effects if warms_with_the_arm(effect)]
    try:
        for name in table.carried:
            if name not in names:
                raise UnknownName("effect of this model", name, names)
        for name in table.warming_rad or {}:
            if name not in laws:
                raise UnknownName("joint's drift of this model", name, laws)
        for key in (
            *table.offsets,
            *(key for memory_table in (table.memory or {}).values() for key in memory_table.offsets),
        ):
            if key not in every:
                raise UnknownName("offset", key, every)
        memory = {
            name: _memory_of(name, memory_table, model, every) for name, memory_table in (table.memory or {}).items()
        }
    except LrmError as error:
        raise FileError(path, "deployed", str(error)) from None
    return StateAfterSession(table.carried, _in_si(table.offsets, every), table.warming_rad or {}, memory)


def _memory_of(name: str, table: MemoryTable, model: Model, every: Mapping[str, Parameter]) -> SessionMemory:
    """Memory of an effect by name. Raises `LrmError`: an effect that has none, or of another number of numbers."""
    by_name = {effect.name: effect for effect in model.effects if isinstance(effect, EffectWithMemory)}
    if name not in by_name:
        raise UnknownName("effect with a memory of this model", name, [*by_name])
    size = by_name[name].memories
    if not len(table.mean) == len(table.sd) == size:
        raise LrmError(f"memory of {name}: {len(table.mean)} and {len(table.sd)} numbers; should be {size} each")
    return SessionMemory(_in_si(table.offsets, every), tuple(table.mean), tuple(table.sd))


def _in_si(offsets: Mapping[str, float], every: Mapping[str, Parameter]) -> dict[str, float]:
    return {key: value * every[key].si for key, value in offsets.items()}


def deployed_table(model: Model) -> DeployedTable | None:
    """The `[deployed]` table of a model, None where no effect of a session leaves a state behind."""
    if model.state is None:
        return None
    units = {key: parameter.si for key, parameter in _offsets(model.arm).items()}

    def stated(offsets: Mapping[str, float]) -> dict[str, float]:
        return {key: value / units[key] for key, value in offsets.items()}

    state = model.state
    memory = {
        name: MemoryTable(offsets=stated(memory_state.parts), mean=list(memory_state.mean), sd=list(memory_state.sd))
        for name, memory_state in state.memory.items()
    }
    return DeployedTable(
        carried=dict(state.carried), offsets=stated(state.offsets), warming_rad=dict(state.warming) or None,
        memory=memory or None,
    )  # fmt: skip


def parts_table(model: Model) -> PartsTable:
    """The `[parts]` table of a model: names of the effects of each part that has any."""
    parts = {part: [effect for effect in model.effects if effect.part is part] for part in ModelPart}
    return {part.value: [effect.name for effect in effects] for part, effects in parts.items() if effects}


def model_tables(model: Model) -> dict[str, Any]:
    """The tables of a model file and of an entry of its history that follow from the model alone, by their names."""
    return {
        "effects": effect_names(model.effects),
        "parameters": parameter_tables(model),
        "range": range_table(model),
        "deployed": deployed_table(model),
        "parts": parts_table(model),
    }


def _offsets(arm: Arm) -> dict[str, Parameter]:
    """Every constant offset of an arm, and every spring or gain that may stand for a memory, by its key."""
    kinds: tuple[type[Effect], ...] = (Offsets, *SPRINGS, ServoGain)
    every = [kind(arm, place) for kind in kinds for place in kind.places(arm)]
    return {key: parameter for effect in every for key, parameter in zip(effect.keys, effect.parameters, strict=True)}


def _range_of(path: Path, table: RangeTable | None, model: Model) -> MeasuredRange | None:
    """The range of a fit (SI). Raises `FileError`: of another number of joints, or of a slot that the arm has not."""
    if table is None:
        return None
    if len(table.joints_deg) != model.arm.dof:
        raise FileError(path, "range", f"joints_deg has {len(table.joints_deg)} rows; should have {model.arm.dof}")
    if any(
        lower > upper
        for lower, upper in (*table.joints_deg, table.payload_g, *table.loads.values(), *(table.tcp_mm or ()))
    ):
        raise FileError(path, "range", "an interval whose end lies before its beginning; should be [lowest, highest]")
    slots = {key.rpartition("_")[0]: (lower, upper) for key, (lower, upper) in table.loads.items()}
    if unknown := next((key for key in slots if key not in model.chain.index), None):
        raise FileError(path, "range.loads", str(UnknownName("slot", unknown, model.chain.index)))
    measured, unknown_deg = table.measured_deg or [], table.open_deg or []
    if {len(measured), len(unknown_deg)} not in ({0}, {model.arm.dof}):
        words = f"measured_deg has {len(measured)} rows and open_deg {len(unknown_deg)} values"
        raise FileError(path, "range", f"{words}; both should have {model.arm.dof}, one for each joint")
    if any(a >= b for row in measured for a, b in pairwise(row)):
        raise FileError(path, "range.measured_deg", "a row that does not ascend; should have each angle once, in order")
    rows = tuple(tuple(map(math.radians, row)) for row in measured)
    unmeasured = UnmeasuredAngles(rows, tuple(map(math.radians, unknown_deg))) if rows else None
    angle = tuple((math.radians(lower), math.radians(upper)) for lower, upper in table.joints_deg)
    lightest, heaviest = table.payload_g
    t, running = (None if ends is None else (ends[0], ends[1]) for ends in (table.t_s, table.running_s))
    tcp = None if table.tcp_mm is None else tuple((1e-3 * lower, 1e-3 * upper) for lower, upper in table.tcp_mm)
    centre = None if table.centre_mm is None else tuple(1e-3 * value for value in table.centre_mm)
    payload, reversion = (1e-3 * lightest, 1e-3 * heaviest), _reversion_of(path, table.reversion, model)
    candidates, names = tuple(table.candidates or ()), [effect.name for effect in model.effects]
    if missing := next((name for name in candidates if name not in names), None):
        raise FileError(path, "range.candidates", str(UnknownName("effect of this model", missing, names)))
    return MeasuredRange(angle, payload, slots, t, running, tcp, centre, unmeasured, reversion, candidates)


def _reversion_of(path: Path, table: ReversionTable | None, model: Model) -> Reversion | None:
    """The reversion of a file (SI). Raises `FileError`: an effect, a joint or a parameter that the model has not."""
    if table is None:
        return None
    names, joints = [effect.name for effect in model.effects], model.arm.joint_names
    try:
        for reversion, what, given in (
            (names, "effect of this model", table.terms),
            (joints, "joint", (*table.below_deg, *table.above_deg)),
            (model.keys, "parameter", table.changes),
        ):
            if unknown := next((name for name in given if name not in reversion), None):
                raise UnknownName(what, unknown, reversion)
    except UnknownName as error:
        raise FileError(path, "range.reversion", str(error)) from None
    ends = tuple(
        (math.radians(table.below_deg.get(joint, -math.inf)), math.radians(table.above_deg.get(joint, math.inf)))
        for joint in joints
    )
    changes = {key: value * model.parameter(key).si for key, value in table.changes.items()}
    return Reversion(tuple(table.terms), ends, changes)


def _reversion_table(model: Model, reversion: Reversion | None) -> ReversionTable | None:
    if reversion is None:
        return None
    below, above = (
        {
            joint: math.degrees(ends[side])
            for joint, ends in zip(model.arm.joint_names, reversion.ends, strict=True)
            if math.isfinite(ends[side])
        }
        for side in (0, 1)
    )
    changes = {key: value / model.parameter(key).si for key, value in reversion.changes.items()}
    return ReversionTable(terms=[*reversion.terms], below_deg=below, above_deg=above, changes=changes)


def range_table(model: Model) -> RangeTable | None:
    """The `[range]` table of a model, None where it is not known."""
    within = model.within
    if within is None:
        return None
    far = within.unmeasured
    unit = {slot.key: "Nm" if slot.rotates else "N" for slot in model.chain.slots}
    return RangeTable(
        joints_deg=[[math.degrees(lower), math.degrees(upper)] for lower, upper in within.angle],
        payload_g=[1e3 * end for end in within.payload],
        t_s=None if within.t is None else [*within.t],
        running_s=None if within.running is None else [*within.running],
        tcp_mm=None if within.tcp is None else [[1e3 * lower, 1e3 * upper] for lower, upper in within.tcp],
        centre_mm=None if within.centre is None else [1e3 * value for value in within.centre],
        measured_deg=None
        if far is None
        else [[round(math.degrees(angle), 4) for angle in row] for row in far.measured],
        open_deg=None if far is None else [math.degrees(sd) for sd in far.sd],
        loads={f"{key}_{unit[key]}": [*ends] for key, ends in within.load.items()},
        reversion=_reversion_table(model, within.reversion),
        candidates=[*model.candidates] or None,
    )


def _own_effects(tables: ModelFile) -> str:
    """Place of a model's own effects, if it has any."""
    provenance = tables.provenance
    if provenance is None or provenance.effects_file is None:
        return ""
    gone = "" if Path(provenance.effects_file).exists() else ", which is gone"
    where = f"{provenance.effects_file}{gone} (sha256 {provenance.effects_sha256})"
    right = "give that file with --effects-file, in Python as read_study's third argument"
    return f"the model has effects of its own, from {where}; {right}"


def parameter_tables(model: Model) -> dict[str, float]:
    """The `[parameters]` table of a model in the file's units: the free ones, and shape parameters."""
    return {
        key: float(value) / parameter.si
        for key, parameter, value in zip(model.keys, model.parameters, model.values, strict=True)
        if key in model.free or parameter.fixed is not None or (value != parameter.default and math.isfinite(value))
    }


def as_tables(file: ModelFile) -> dict[str, Any]:
    """A model file as plain tables for a TOML writer."""
    return file.model_dump(mode="json", by_alias=True, exclude_none=True)
