"""Tables of measurements and poses, columns named as in our own files (docs/files.md), whatever the file calls them.

Capitals, usual aliases, units in the names or in a row of their own, joints counted from 0 or by their own names.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby, product
from types import MappingProxyType

from lrm_ident.data.measurement_file.conventions import ANGLE_UNITS, LENGTH_UNITS
from lrm_ident.data.measurement_file.known_columns import ALIASES, ANGLE, FEEDBACK, TILT
from lrm_ident.data.measurement_file.pose_quantity import (
    DISTANCE,
    PLACEMENT,
    POINT,
    POSITION,
    QUATERNION,
    PoseQuantity,
)
from lrm_ident.data.table_text.csv_file import Column, CsvTable, is_number
from lrm_ident.data.wording import enumerate_words
from lrm_math.arm.arm import Arm
from lrm_math.errors import FileError
from lrm_math.model.reading import AS_NAMED, Reading

NO_UNIT = ("-", "1", "#")
"""Cells of a row of units below columns that have none."""
ANGLES, MEASURED_ANGLES = re.compile(r"q(\d+)_deg"), re.compile(r"q\d+_meas_deg")
OF_A_ROBOT = {"": ANGLE, "action": ANGLE, "observationstate": FEEDBACK, "observation": FEEDBACK}
"""Our columns by what stands before the joints' own names: LeRobot's commands, and what its encoders read."""
BEFORE_JOINTS, SIDES = ("main_", "arm_", "follower_"), ("left_", "right_", "left_arm_", "right_arm_")
"""What stands before the names of the joints of one arm, and of one of two."""
NAMES_ARM = ("arm", "robot", "armid", "robotid", "armname", "robotname")
"""Columns, squeezed, that say of which arm a row is."""
YAW = ("yaw", "yawdeg", "yaw(deg)", "yaw[deg]", "heading", "headingdeg")
"""Columns, squeezed, of the third angle beside roll and pitch."""
ARMS_LISTED = 4
MISSED = (("payload_g", "load"), ("t_s", "time"), ("session", "session"))
"""Quantities without which a model is another one, so that a file that has them by other names has to be told."""
UNIT_WORDS = {
    "mm": "mm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "cm": "cm", "centimeter": "cm", "centimeters": "cm",
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "um": "um", "µm": "um", "μm": "um", "micron": "um", "microns": "um", "micrometer": "um",
    "in": "inch", "inch": "inch", "inches": "inch",
    "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "grad": "grad",
    "rad": "rad", "radian": "rad", "radians": "rad",
    "s": "s", "sec": "s", "seconds": "s", "ms": "ms", "milliseconds": "ms", "min": "min", "minutes": "min",
    "us": "us", "µs": "us", "μs": "us", "microseconds": "us", "ns": "ns", "nanoseconds": "ns", "h": "h", "hours": "h",
    "g": "g", "gr": "g", "gram": "g", "grams": "g", "gramm": "g", "kg": "kg",
    "c": "c", "°c": "c", "degc": "c", "v": "v",
}  # fmt: skip
FACTORS: dict[str, dict[str | None, float]] = {
    "mm": {unit: metres / LENGTH_UNITS["mm"] for unit, metres in LENGTH_UNITS.items()},
    "deg": {unit: radians / ANGLE_UNITS["deg"] for unit, radians in ANGLE_UNITS.items()},
    "g": {"g": 1.0, "kg": 1e3},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "c": {"c": 1.0},
    "v": {"v": 1.0},
}
"""File units of our own columns, and what other units are in them."""

JOINT = re.compile(
    r"(?:q|j|a|joint|axis|theta|th|θ|angle|motor|servo)(?:angle|pos|position)?(\d+)(?:angle|pos|position)?"
)
JOINT_WORDS = re.compile(r"(?:q|j|a|joint|axis|theta|th|θ|angle|motor|servo|pos|position)+s?")
ENCODER_WORDS = re.compile(r"actual|measured|meas|present|feedback|encoder|observed")
COMMAND_WORDS = re.compile(r"target|commanded|command|cmd|desired|goal|setpoint")
"""Words, squeezed, of names of joint angles: of what encoders read, and of what was commanded."""
COORDINATE = re.compile(
    r"(?:(?:tcp|tool|tip|ee|eef|pos|position|p|meas|measured|target|tracker)+)?([xyz])(?:tcp|tool|tip|pos|meas|measured)?"
)


def named_columns(file: CsvTable, how: Reading = AS_NAMED, arm: Arm | None = None) -> CsvTable:
    """The table of a file: columns named as ours, in the units that `how` states in place of those of their names;
    poses numbered 1, 2, 3 … where no column does it.

    `arm`: its own names of its joints are names of columns too.

    Raises `FileError`: two columns that are the same by name.
    """
    table = _with_units(file)
    named = _our_names(table, [] if arm is None else [joint.name for joint in arm.joints])
    first = 0 if any(column.name == "q0_deg" for column in named) else 1
    columns = tuple(_as_said(column, how, first) for column in named)
    table = _with_numbered_poses(table, [column.name for column in columns])
    if all(column.name != "pose" for column in columns):
        rows = tuple((str(number), *row) for number, row in enumerate(table.rows, start=1))
        return replace(table, columns=(Column("pose", "pose"), *columns), rows=rows)
    return replace(table, columns=columns)


def _with_numbered_poses(table: CsvTable, names: Sequence[str]) -> CsvTable:
    """The table with the numbers of poses whose names differ by their number alone (`P001`), with a notice."""
    if "pose" not in names:
        return table
    places = [j for j, name in enumerate(names) if name in ("pose", "repeat_of")]
    numbered = [re.fullmatch(r"(.*\D)(\d+)", row[names.index("pose")]) for row in table.rows]
    before = {match[1] for match in numbered if match}
    if not all(numbered) or len(before) != 1:
        return table
    (word,) = before
    rows = tuple(
        tuple(cell.removeprefix(word) if j in places else cell for j, cell in enumerate(row)) for row in table.rows
    )
    notice = f"poses are numbered as their names are: '{table.rows[0][places[0]]}' is {int(rows[0][places[0]])}"
    return replace(table, rows=rows, notices=(*table.notices, notice))


def arm_columns(file: CsvTable, arm: Arm, how: Reading, quantities: Sequence[PoseQuantity]) -> CsvTable:
    """The table of a file of an arm's poses, as `named_columns`, with notices of its columns.

    Raises `FileError`: the file has another number of joints, or rows of several arms.
    """
    named = named_columns(file, how, arm)
    _check_one_arm(named)
    _check_tilt(named)
    stated = [name for name in named.header if ANGLES.fullmatch(name)]
    if not {*stated} <= {ANGLE.format(number) for number in range(1, arm.dof + 1)}:
        what = f"{len(stated)} joints, {arm.name} has {arm.dof}"
        raise FileError(file.path, "header", what, "is this another arm?")
    return replace(named, notices=(*_notices(named, quantities), *named.notices))


def _check_one_arm(table: CsvTable) -> None:
    """Raises `FileError` if a column says that rows are of different arms: one model cannot hold for them."""
    for j, name in enumerate(table.header):
        named = {row[j].casefold(): row[j] for row in table.rows if row[j]}
        arms = sorted(named.values()) if _squeezed(name.lower()) in NAMES_ARM else []
        if len(arms) > 1:
            what = f"rows of {len(arms)} arms: {enumerate_words(arms, ARMS_LISTED)}"
            raise FileError(table.path, f"column {name}", what, "write the rows of each arm into a file of its own")


def _check_tilt(table: CsvTable) -> None:
    """Raises `FileError` if a yaw stands beside roll and pitch: that may as well be the orientation of the tool."""
    yaw = next((name for name in table.header if name and _squeezed(name.lower()) in YAW), None)
    if yaw is not None and {*TILT} <= {*table.header}:
        what = f"{', '.join(TILT)} and {yaw}: of the tool, or how the base leans?"
        right = f"of the tool: write qw, qx, qy, qz, or delete the three; of the base: delete {yaw}"
        raise FileError(table.path, "header", what, right)


def stated_units(table: CsvTable) -> Reading:
    """Units of the file's positions and angles."""
    factors = {column.name: column.factor for column in table.columns}
    lengths, angles = ({factor: unit for unit, factor in FACTORS[base_unit].items()} for base_unit in ("mm", "deg"))
    units = {"unit": lengths[factors.get("x_mm", 1.0)], "angle_unit": angles[factors.get("q1_deg", 1.0)]}
    return Reading.model_validate(units)


def unused_columns(table: CsvTable, quantities: Sequence[PoseQuantity]) -> tuple[str, ...]:
    """Names of the columns that mean none of the `quantities` quantities."""
    names = _meant(quantities)
    return tuple(name for name in table.header if name and name not in names)


def _meant(quantities: Sequence[PoseQuantity]) -> set[str]:
    return {*(name for quantity in quantities for name in quantity.columns), POINT, PLACEMENT}


def _notices(table: CsvTable, quantities: Sequence[PoseQuantity]) -> list[str]:
    """Columns that are not used, and those that are read under another name or in another unit."""
    names, unknown = _meant(quantities), unused_columns(table, quantities)
    absent = {what: name for name, what in MISSED if name in names and name not in table.header}
    hint = f". If one is a {_either([*absent])}, name it {_either([*absent.values()])}" if absent else ""
    notices = [f"columns not used: {', '.join(unknown)}{hint}"] if unknown else []
    taken = [
        reading
        for reading in table.columns
        if reading.name in names
        and reading.name != reading.stated
        and (reading.factor != 1.0 or not reading.stated.lower().startswith(reading.name))
    ]
    return [*notices, f"read as: {', '.join(_taken_for(taken))}"] if taken else notices


def _either(words: Sequence[str]) -> str:
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _taken_for(columns: Sequence[Column]) -> Iterator[str]:
    """What columns were taken for; of columns that differ by their number alone the first and the last."""
    for (_, _, factor), each in groupby(
        columns, lambda reading: (_unnumbered(reading.name), _unnumbered(reading.stated), reading.factor)
    ):
        alike = list(each)
        ends = [alike[0], *alike[1:][-1:]]
        names, stated = (
            " … ".join(reading.name for reading in ends),
            " … ".join(f"'{reading.stated}'" for reading in ends),
        )
        yield f"{names} = {stated}" + ("" if factor == 1.0 else f" times {factor:.6g}")


def _unnumbered(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def _our_names(table: CsvTable, joints: Sequence[str]) -> list[Column]:
    """The columns by our own names, by the file's where they are not known; the joints' own count if all are there.

    Raises `FileError`: two columns that are the same by name.
    """
    named = _names_of_joints(table, joints) or _numbered_alike(table, len(joints))
    turned = _leica_quaternion(table)
    readings = [
        Column(turned[name], name)
        if name in turned
        else Column(name, name)
        if _is_measured(name) or name == "pose"
        else column_name(name, named)
        for name in table.header
    ]
    exact = {reading.name for reading in readings if reading and reading.name == reading.stated}
    same: defaultdict[str, list[str]] = defaultdict(list)
    columns = []
    for our_reading, name in zip(readings, table.header, strict=True):
        if our_reading is None or (
            name != our_reading.name and our_reading.name in exact and not _is_measured(our_reading.name)
        ):
            columns.append(Column(name, name))
        else:
            columns.append(our_reading)
            same[our_reading.name].append(name)
    for ours, theirs in same.items():
        if len(theirs) > 1:
            twice = len(set(theirs)) == 1
            which = f"column {theirs[0]} stands twice" if twice else f"{' and '.join(theirs)} are both {ours}"
            raise FileError(table.path, f"header, line {table.header_line}", which, "leave one, or rename the other")
    return columns


def _names_of_joints(table: CsvTable, joints: Sequence[str]) -> dict[str, str]:
    """Our columns by the joints' own names, squeezed, as LeRobot writes them; of each kind that has all joints."""
    words = {words for name in table.header for words, _ in _readings(name)}
    named: dict[str, str] = {}
    for (before, ours), side in product(OF_A_ROBOT.items(), ("", *map(_squeezed, (*BEFORE_JOINTS, *SIDES)))):
        names = {
            before + side + _squeezed(name.lower()) + end: ours.format(number)
            for number, name in enumerate(joints, start=1)
            for end in ("", "pos")
        }
        if all(joints) and {*names.values()} <= {names.get(word) for word in words}:
            named |= names
    return named


def _numbered_alike(table: CsvTable, count: int) -> dict[str, str]:
    """Our columns by names, squeezed, that differ by their number alone: `Achse1` … `Achse6`, in whatever language.

    Those of joints with a word of encoders (`actual_q_0` …) are what encoders read. One other family is what was
    commanded, unless a column is known as a joint's. A family has as many columns as the arm joints, and is the only
    one that names joints, or the only one.
    """
    our_names = [column_name(name) for name in table.header]
    families: defaultdict[tuple[str, str], dict[int, str]] = defaultdict(dict)
    for name, column in zip(table.header, our_names, strict=True):
        words, unit = next(_readings(name), ("", None))
        numbered = re.fullmatch(r"(\D+)(\d+)(\D*)", words)
        if column is None and numbered and unit in (None, *ANGLE_UNITS):
            families[numbered[1], numbered[3]][int(numbered[2])] = words
    whole = {
        "".join(stem): names
        for stem, names in families.items()
        if sorted(names) in ([*range(count)], [*range(1, count + 1)])
    }
    read = {stem: names for stem, names in whole.items() if ENCODER_WORDS.search(stem)}
    commanded = {stem: names for stem, names in whole.items() if stem not in read}
    named = _only(_of_joints(read), FEEDBACK)
    if any(column is not None and ANGLES.fullmatch(column.name) for column in our_names):
        return named
    return named | (_only(_of_joints(commanded), ANGLE) or _only([*commanded.values()], ANGLE))


def _of_joints(families: Mapping[str, dict[int, str]]) -> list[dict[int, str]]:
    """Those of some families of names, by their stems, that name joints."""
    bare = {stem: ENCODER_WORDS.sub("", COMMAND_WORDS.sub("", stem)) for stem in families}
    return [names for stem, names in families.items() if JOINT_WORDS.fullmatch(bare[stem])]


def _only(families: Sequence[dict[int, str]], ours: str) -> dict[str, str]:
    """Our columns by the names of the only one of some families; empty if there are several or none."""
    if len(families) != 1:
        return {}
    first = min(families[0])
    return {words: ours.format(number - first + 1) for number, words in families[0].items()}


def _leica_quaternion(table: CsvTable) -> dict[str, str]:
    """Columns Q0 … Q3 that are an orientation, as Leica's trackers write it: no Q4, and of length one in every row."""
    theirs = {name: name.strip().lower() for name in table.header}
    there = {word: name for name, word in theirs.items() if re.fullmatch(r"q\d+", word)}
    if [*there] != ["q0", "q1", "q2", "q3"] or not table.rows:
        return {}
    columns = [table.header.index(name) for name in there.values()]
    for row in table.rows:
        numbers = [float(row[j]) for j in columns if is_number(row[j])]
        if len(numbers) not in (0, 4) or (numbers and abs(math.hypot(*numbers) - 1.0) > 0.01):
            return {}
    return dict(zip(there.values(), QUATERNION, strict=True))


def _as_said(column: Column, how: Reading, first: int) -> Column:
    """A column in the unit that `how` states, joints numbered from 1; `first`: the number that they begin with."""
    joint = ANGLES.fullmatch(column.name)
    if joint:
        factor = FACTORS["deg"][how.angle_unit] if how.angle_unit else column.factor
        return Column(ANGLE.format(int(joint[1]) + 1 - first), column.stated, factor)
    if how.angle_unit and MEASURED_ANGLES.fullmatch(column.name) and column.stated.lower() != column.name:
        return replace(column, factor=FACTORS["deg"][how.angle_unit])
    if how.unit and column.name in (*POSITION, DISTANCE):
        return replace(column, factor=FACTORS["mm"][how.unit])
    return column


def _with_units(table: CsvTable) -> CsvTable:
    """The table with the units of a first row of units, which has no number, in the names of its columns.

    A unit that is not known stays in a name that is not known either. The same row further down is
    left out, too, as in files that were put together. Raises `FileError`: a name states another unit, or the unit of
    a quantity is not known.
    """
    words = [cell.strip().strip("[]()") for cell in table.rows[0]] if table.rows else []
    words = ["" if word in NO_UNIT else word for word in words]
    word_units = [UNIT_WORDS.get(word.lower()) for word in words]
    if not any(word_units) or any(map(is_number, words)):
        return table
    units = [unit or _stated_unit(table, *each) for *each, unit in zip(table.header, words, word_units, strict=True)]
    columns = []
    for name, unit in zip(table.header, units, strict=True):
        reading = next((candidate for _, candidate in _readings(name) if candidate), None)
        if unit and reading and reading != unit:
            right = "leave the row of units out, or correct it"
            raise FileError(table.path, f"line {table.lines[0]}, column {name}", f"its unit is stated as {unit}", right)
        stated = f"{name} [{unit}]" if unit and not reading else name
        columns.append(Column(stated, stated))
    return replace(table.without(table.rows[0]), columns=tuple(columns))


def _stated_unit(table: CsvTable, name: str, word: str) -> str:
    """The word of a row of units that is none that is known; empty for a column without a unit, such as a number.

    Raises `FileError`: the column is read, and has a unit.
    """
    column = column_name(name)
    if not word or column is None:
        return word
    unit_stated = column.name.rpartition("_")[2]
    if unit_stated in FACTORS:
        same_kind = ", ".join(
            text for text, unit in UNIT_WORDS.items() if unit == unit_stated or unit in FACTORS[unit_stated]
        )
        where = f"line {table.lines[0]}, column {name}"
        raise FileError(table.path, where, f"the unit '{word}' is not known", f"one of {same_kind}")
    return ""


def _is_measured(name: str) -> bool:
    return name in POSITION or ANGLES.fullmatch(name) is not None


def column_name(text: str, named: Mapping[str, str] = MappingProxyType({})) -> Column | None:
    """The column of a measurement file that a name means; None if that is not known, or its unit does not fit it.

    `named`: names of columns by an arm's own names of its joints, squeezed.
    """
    for words, unit in _readings(text):
        joint, position = JOINT.fullmatch(words), COORDINATE.fullmatch(words)
        standard_name = f"q{int(joint[1])}_deg" if joint else f"{position[1]}_mm" if position else ALIASES.get(words)
        name = named.get(words, standard_name)
        factors = {None: 1.0} | FACTORS.get((name or "").rpartition("_")[2], {})
        if name is not None and unit in factors:
            return Column(name, text, factors[unit])
    return None


def _readings(text: str) -> Iterator[tuple[str, str | None]]:
    """The name without its unit, and the unit: `X [mm]`, `x(mm)`, `x_mm`, `x mm`, `x in mm`, or no unit."""
    plain = text.strip().lower()
    bracketed = re.fullmatch(r"(.*?)[\s_]*[\[(]\s*(.+?)\s*[\])]", plain)
    if bracketed:
        if bracketed[2] in UNIT_WORDS:
            yield _squeezed(bracketed[1]), UNIT_WORDS[bracketed[2]]
        return
    divided = re.fullmatch(r"(.+?)(?:[\s_]+in)?[\s_./-]+([^\s_./-]+)", plain)
    if divided and divided[2] in UNIT_WORDS:
        yield _squeezed(divided[1]), UNIT_WORDS[divided[2]]
    yield _squeezed(plain), None


def _squeezed(name: str) -> str:
    return re.sub(r"[\s_./-]+", "", name)
