"""Reader of arm files: `config/arms/NAME.toml` (mm, deg, g, us) -> `Arm` (SI)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field, ValidationError

from lrm_math.arm.arm import (
    MOST_JOINTS,
    Arm,
    Body,
    Joint,
    MimicJoint,
    Placement,
    TypicalSizes,
    contradictions,
    link_places,
    within_mimics,
)
from lrm_math.arm.collision_shapes import Box, Capsule, Shapes
from lrm_math.arm.plausible_arm import ImplausibleArm, Rule, implausible
from lrm_math.arm.servo_table import ServoTable
from lrm_math.arm.vehicle import Vehicle
from lrm_math.arrays import Vector3
from lrm_math.errors import FileError, LrmError, name_suggestion, raise_faults
from lrm_math.toml_file import S, StrictSchema, parse_toml, schema_faults

MM, GRAM, MICROSECOND = 1e-3, 1e-3, 1e-6
ARM_SCHEMA = "lrm/arm/1"
Built = TypeVar("Built")

Components = Annotated[list[float], Field(min_length=3, max_length=3)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
Length = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]
Size = Annotated[float, Field(gt=0.0, le=10_000.0)]
Point = Annotated[list[Length], Field(min_length=3, max_length=3)]
Name = Annotated[str, Field(min_length=1)]


class PlacementTable(StrictSchema):
    """Tables `[base]` and `[tool]`."""

    x_mm: Length = 0.0
    y_mm: Length = 0.0
    z_mm: Length = 0.0
    alpha_deg: Angle = 0.0
    beta_deg: Angle = 0.0
    gamma_deg: Angle = 0.0


class ServoCalibrationTable(StrictSchema):
    """A level-1 table: measured angles and the pulses that gave them."""

    angle_deg: Annotated[list[Angle], Field(min_length=2)]
    pulse_us: Annotated[list[Annotated[float, Field(ge=100, lt=20_000)]], Field(min_length=2)]


def _ascending(limits: list[float]) -> list[float]:
    if not limits[0] < limits[1]:
        raise ValueError("[lower, upper] with lower < upper")
    return limits


class FollowTable(StrictSchema):
    """`follow` of a joint without a motor: its angle is `ratio` times that of another joint, and an offset."""

    joint: Name
    ratio: Annotated[float, Field(ge=-100.0, le=100.0)] = 1.0
    offset_deg: Angle = 0.0


class JointTable(StrictSchema):
    """One `[[joint]]`, in the order of the chain."""

    theta_deg: Angle
    d_mm: Length
    a_mm: Length
    alpha_deg: Angle
    extra_z_mm: Length | None = None
    beta_deg: Angle = 0.0
    name: str = ""
    limits_deg: Annotated[list[Angle], Field(min_length=2, max_length=2), AfterValidator(_ascending)]
    servo: ServoCalibrationTable | None = None
    follow: FollowTable | None = None


class BodyTable(StrictSchema):
    """One `[[body]]`."""

    name: Annotated[str, Field(min_length=1)]
    mass_g: Annotated[float, Field(ge=0.0, le=1e6)]
    com_mm: Components
    com_from: Literal["frame", "near_end"] = "frame"
    frame: str
    loads_joint: int
    carries_payload: bool = False


class CapsuleTable(StrictSchema):
    """One `[[capsule]]`: collision geometry of a link, or of something mounted on it."""

    name: Name
    frame: str
    from_mm: Point
    to_mm: Point
    radius_mm: Size
    estimated: bool = False


class BoxTable(StrictSchema):
    """One `[[box]]`: a fixed obstacle around the arm. `world` is the frame of TCP positions."""

    name: Name
    frame: Literal["world", "base"] = "world"
    center_mm: Point
    size_mm: Annotated[list[Size], Field(min_length=3, max_length=3)]
    alpha_deg: Angle = 0.0
    beta_deg: Angle = 0.0
    gamma_deg: Angle = 0.0
    estimated: bool = False


class CollisionTable(StrictSchema):
    """Table `[collision]`: the margin between shapes, and the pairs exempt from it."""

    margin_mm: Annotated[float, Field(ge=0.0, le=1_000.0)] = 30.0
    ignore: list[Annotated[list[Name], Field(min_length=2, max_length=2)]] = []


class VehicleTable(StrictSchema):
    """Table `[vehicle]`: what the arm stands on, without the arm; its wheels' contacts in order round it."""

    mass_g: Annotated[float, Field(gt=0.0, le=1e7)]
    com_mm: Point
    contacts_mm: Annotated[list[Point], Field(min_length=3, max_length=16)]


class TypicalSizesTable(StrictSchema):
    """Table `[typical_sizes]`: how far an arm of this make usually is from its drawing, and gives way."""

    length_mm: Annotated[float, Field(gt=0.0, le=100.0)] = TypicalSizes.length / MM
    angle_deg: Annotated[float, Field(gt=0.0, le=45.0)] = math.degrees(TypicalSizes.angle)
    compliance: Annotated[float, Field(alias="compliance_rad_per_Nm", gt=0.0, le=10.0)] = TypicalSizes.compliance


class ArmFile(StrictSchema):
    """The whole file, schema `lrm/arm/1`."""

    schema_: Literal["lrm/arm/1"] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1)]
    source: str = ""
    accepted: list[Rule] = []
    gravity_m_per_s2: Components
    table_z_mm: Length | None = None
    base: PlacementTable
    joint: Annotated[list[JointTable], Field(min_length=1, max_length=MOST_JOINTS)]
    tool: PlacementTable
    body: list[BodyTable]
    auxiliary_servo: dict[str, ServoCalibrationTable] = {}
    capsule: list[CapsuleTable] = []
    box: list[BoxTable] = []
    collision: CollisionTable = CollisionTable()
    typical_sizes: TypicalSizesTable = TypicalSizesTable()
    vehicle: VehicleTable | None = None


def shipped_arms() -> dict[str, Path]:
    """Arms that come with the software, by name."""
    here = Path(__file__).resolve().parents[1]
    folders = [here / "arms", here.parent / "config" / "arms"]
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def arm_name_for(arm: str, folder: Path) -> str:
    """Name of a shipped arm, or path of an arm file as a file in `folder` states it: relative if it lies there."""
    path = Path(arm)
    if path.suffix != ".toml":
        return arm
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return path.resolve().as_posix()


def arm_of(path: Path, arm: str) -> Arm:
    """The arm named in a file: a shipped one, or a path relative to the file's folder or the working directory."""
    if arm in shipped_arms():
        return load_arm(arm)
    beside = path.parent / arm
    try:
        return load_arm(beside if beside.exists() else arm)
    except FileError as error:
        raise error if error.path.endswith(".toml") else FileError(path, "arm", str(error)) from None


def load_arm(name_or_path: str | Path) -> Arm:
    """Loads an arm by the name of a shipped one or by path.

    Raises:
        FileError: no such arm, or a file that does not fit the schema or contradicts itself.
    """
    shipped = shipped_arms()
    if isinstance(name_or_path, str) and name_or_path in shipped:
        return read_arm(shipped[name_or_path])
    path = Path(name_or_path)
    if not path.exists() and path.suffix != ".toml":
        names = ", ".join(sorted(shipped))
        raise FileError(name_or_path, "", "no such arm", f"give the path of an arm file, or one of: {names}")
    return read_arm(path)


def read_arm(path: Path) -> Arm:
    """Reads one arm file. Raises `FileError`, `FileFaults` if there is more than one fault."""
    tables = parse_toml(path)
    faults = schema_faults(path, tables, ArmFile)
    if not faults or tables.get("schema") == ARM_SCHEMA:
        faults += [FileError(path, "", fault) for fault in _contradictions(tables)]
    raise_faults(path, faults)
    try:
        arm = to_arm(ArmFile.model_validate(tables))
    except LrmError as error:
        raise FileError(path, "", str(error)) from None
    raise_faults(path, [FileError(path, "", fault.what, _right(fault)) for fault in implausible(arm)])
    return arm


def _right(fault: ImplausibleArm) -> str:
    return f'{fault.right}; if that is your arm, write accepted = ["{fault.rule}"] below name'


def _contradictions(tables: dict[str, Any]) -> Iterator[str]:
    """Contradictions between valid tables of an arm file, whatever is wrong with the others."""
    listed = _listed(tables, "joint")
    places = link_places([isinstance(t, dict) and "follow" in t for _, t in listed])
    faults: list[str] = []
    joints = [_built(t, JointTable, partial(_joint, number), faults) for number, t in listed]
    bodies = [_built(t, BodyTable, partial(_body, places=places), faults) for _, t in _listed(tables, "body")]
    for _, capsule in _listed(tables, "capsule"):
        _built(capsule, CapsuleTable, partial(_capsule, places=places), faults)
    yield from faults
    yield from contradictions(joints, [body for body in bodies if body is not None])


def _listed(tables: dict[str, Any], name: str) -> list[tuple[int, Any]]:
    entries = tables.get(name)
    return list(enumerate(entries, start=1)) if isinstance(entries, list) else []


def _built(raw: Any, schema: type[S], build: Callable[[S], Built], faults: list[str]) -> Built | None:
    """Object that a table describes; None if it is not valid, or, with a line in `faults`, contradicts itself."""
    try:
        return build(schema.model_validate(raw))
    except ValidationError:
        return None
    except LrmError as error:
        faults.append(str(error))
        return None


def to_arm(tables: ArmFile) -> Arm:
    """The arm of parsed tables, in SI. Raises `LrmError` for values that contradict each other."""
    places = link_places([joint.follow is not None for joint in tables.joint])
    links = [_joint(number, joint) for number, joint in enumerate(tables.joint, start=1)]
    mimics = tuple(_mimics(tables.joint, links, places))
    links_of_joints = tuple(link for link, table in zip(links, tables.joint, strict=True) if table.follow is None)
    arm = Arm(
        name=tables.name,
        gravity=_vector(tables.gravity_m_per_s2, 1.0),
        base=_placement(tables.base),
        joints=within_mimics(links_of_joints, mimics),
        mimics=mimics,
        tool=_placement(tables.tool),
        bodies=tuple(_body(body, places) for body in tables.body),
        auxiliary_servos=tuple(
            (name, _servo(f"auxiliary_servo {name}", table)) for name, table in tables.auxiliary_servo.items()
        ),
    )
    sizes = tables.typical_sizes
    typical = TypicalSizes(sizes.length_mm * MM, math.radians(sizes.angle_deg), sizes.compliance)
    arm = replace(arm, shapes=_shapes(tables, places), vehicle=_vehicle(tables.vehicle))
    table = None if tables.table_z_mm is None else tables.table_z_mm * MM
    return replace(arm, typical_sizes=typical, accepted=tuple(tables.accepted), table=table)


def _mimics(tables: Sequence[JointTable], links: Sequence[Joint], places: Sequence[str]) -> Iterator[MimicJoint]:
    """The joints that follow others, outwards. Raises `LrmError`: what one follows is no joint with a motor."""
    motors = [place for place in places if place.startswith("joint")]
    for number, (table, link) in enumerate(zip(tables, links, strict=True)):
        if table.follow is None:
            continue
        named = {link.name: place for link, place in zip(links, places, strict=True) if link.name}
        leader = table.follow.joint if table.follow.joint in motors else named.get(table.follow.joint, "")
        if leader not in motors:
            right = f"should be a joint with a motor of its own: {', '.join(motors) or 'there is none'}"
            raise LrmError(f"joint {number + 1}: follow: joint = '{table.follow.joint}'; {right}")
        after = sum(place in motors for place in places[:number])
        offset = math.radians(table.follow.offset_deg)
        yield MimicJoint(link, after, motors.index(leader), table.follow.ratio, offset)


def _placement(t: PlacementTable) -> Placement:
    angles = (math.radians(angle) for angle in (t.alpha_deg, t.beta_deg, t.gamma_deg))
    return Placement(t.x_mm * MM, t.y_mm * MM, t.z_mm * MM, *angles)


def _joint(number: int, t: JointTable) -> Joint:
    lower, upper = (math.radians(limit) for limit in t.limits_deg)
    if t.follow is not None and t.servo is not None:
        raise LrmError(f"joint {number}: follows {t.follow.joint}, so it has no servo of its own")
    return Joint(
        theta=math.radians(t.theta_deg),
        d=t.d_mm * MM,
        a=t.a_mm * MM,
        alpha=math.radians(t.alpha_deg),
        extra_z=None if t.extra_z_mm is None else t.extra_z_mm * MM,
        lower=lower,
        upper=upper,
        servo=None if t.servo is None else _servo(f"joint {number}", t.servo),
        beta=math.radians(t.beta_deg),
        name=t.name,
    )


def _servo(where: str, t: ServoCalibrationTable) -> ServoTable:
    try:
        return ServoTable(tuple(math.radians(a) for a in t.angle_deg), tuple(p * MICROSECOND for p in t.pulse_us))
    except LrmError as error:
        raise LrmError(f"{where}: {error}") from None


def _body(t: BodyTable, places: Sequence[str]) -> Body:
    return Body(
        name=t.name,
        mass=t.mass_g * GRAM,
        com=_vector(t.com_mm, MM),
        frame=_frame(f"body '{t.name}'", t.frame, places),
        loads_joint=t.loads_joint,
        near_end=t.com_from == "near_end",
        carries_payload=t.carries_payload,
    )


def _vehicle(t: VehicleTable | None) -> Vehicle | None:
    if t is None:
        return None
    return Vehicle(t.mass_g * GRAM, _vector(t.com_mm, MM), tuple(_vector(contact, MM) for contact in t.contacts_mm))


def _shapes(tables: ArmFile, places: Sequence[str]) -> Shapes:
    return Shapes(
        capsules=tuple(_capsule(capsule, places) for capsule in tables.capsule),
        boxes=tuple(_box(box) for box in tables.box),
        margin=tables.collision.margin_mm * MM,
        ignored=tuple((pair_first, other) for pair_first, other in tables.collision.ignore),
    )


def _capsule(t: CapsuleTable, places: Sequence[str]) -> Capsule:
    frame = _frame(f"capsule '{t.name}'", t.frame, places)
    return Capsule(t.name, frame, _vector(t.from_mm, MM), _vector(t.to_mm, MM), t.radius_mm * MM, t.estimated)


def _box(t: BoxTable) -> Box:
    rotation = _vector([t.alpha_deg, t.beta_deg, t.gamma_deg], math.radians(1.0))
    return Box(t.name, _vector(t.center_mm, MM), _vector(t.size_mm, MM), rotation, t.frame == "base", t.estimated)


def _frame(what: str, name: str, places: Sequence[str]) -> int:
    frames = ["base", *places, "tool"]
    if name not in frames:
        raise LrmError(f"{what}: unknown frame '{name}'; {name_suggestion(name, frames)}")
    return frames.index(name)


def _vector(values: list[float], unit: float) -> Vector3:
    x, y, z = values
    return x * unit, y * unit, z * unit
