"""A single change of a healthy file, as newcomers make them, is never silently wrong, and never a traceback."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from lrm_ident.data.error_stats import error_stats
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model_file import load_model
from tests.ident.measuring.recordings.test_lerobot import written
from tests.support.commands import run_command
from tests.support.misreadings import of_its_stiffness
from tests.support.scaled_arm import scaled_arm
from tests.support.sweep import seeds
from validation import synthetic

ARMS = ("lrm-lab", "so101", "ur5", "lrm-rover", "two-joint")
LOAD_KG = {"ur5": 1.5}
POSES, SEED, NOISE_M = 60, 7, 3e-4
POSITION = ("x_mm", "y_mm", "z_mm")
UNITS = ("metre", "inch", "micrometre", "unit", "collapse", "shrinks")
AXES = ("mirrored", "swapped", "turned", "another frame", "counted the other way")
Table = dict[str, Array]
"""Columns of a file of measurements."""
Change = Callable[[Table, np.random.Generator], tuple[str, ...]]
"""Changes a table in place; words of which any names the change."""


def _about(name: str) -> tuple[str, ...]:
    return name, f"joint {name[1:-4]}", f"joint{name[1:-4]}", "radian", "beyond", "full turn", *AXES


def _angle(table: Table, rng: np.random.Generator) -> str:
    return str(rng.choice([name for name in table if name.startswith("q")]))


def unit_of_positions(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    factor = rng.choice([1e-3, 1 / 25.4, 1e3])
    for name in POSITION:
        table[name] *= factor
    return UNITS


def unit_of_an_axis(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    name = str(rng.choice(POSITION))
    table[name] *= 1e-3
    return name, *UNITS


def unit_of_angles(table: Table, _rng: np.random.Generator) -> tuple[str, ...]:
    for name in table:
        table[name] *= np.pi / 180.0 if name.startswith("q") else 1.0
    return ("radian",)


def unit_of_an_angle(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    name = _angle(table, rng)
    table[name] *= np.pi / 180.0
    return _about(name)


def unit_of_loads(table: Table, _rng: np.random.Generator) -> tuple[str, ...]:
    table["payload_g"] *= 1e-3
    return ("payload",)


def sign(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    name = str(rng.choice([_angle(table, rng), *POSITION]))
    table[name] *= -1.0
    return _about(name)


def order_of_columns(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    angles = [name for name in table if name.startswith("q")]
    one, other = rng.choice(POSITION if rng.random() < 0.5 else angles, 2, replace=False).tolist()
    table[one], table[other] = table[other], table[one]
    return *_about(one), *_about(other)


def order_of_rows(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    row = int(rng.integers(POSES - 1))
    for name in POSITION:
        table[name][[row, row + 1]] = table[name][[row + 1, row]]
    return f"pose {row + 1}", f"pose {row + 2}", f"pose: {row + 1}", f"--leave-out {row + 1}"


def seam(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    """A joint a full turn away, in all rows or beyond an angle."""
    name = _angle(table, rng)
    far = table[name] > (-np.inf if rng.random() < 0.5 else np.median(table[name]))
    table[name] += 360.0 * rng.choice([-1.0, 1.0]) * far
    return _about(name)


def zero(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    """A joint counted from another zero, perhaps the other way."""
    name = _angle(table, rng)
    table[name] = rng.choice([-180.0, -90.0, 90.0, 180.0]) + rng.choice([-1.0, 1.0]) * table[name]
    return _about(name)


def coupled(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    """A joint counted with the one before, as rods couple them."""
    number = int(rng.integers(2, 1 + sum(name.startswith("q") for name in table)))
    table[f"q{number}_deg"] += rng.choice([-1.0, 1.0]) * table[f"q{number - 1}_deg"]
    return *_about(f"q{number}_deg"), *_about(f"q{number - 1}_deg")


def stale(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    """The tracker shows the same position for some poses."""
    row = int(rng.integers(POSES - 4))
    for name in POSITION:
        table[name][row + 1 : row + 4] = table[name][row]
    return "stands still", f"pose {row + 1}", f"--leave-out {row + 2}"


def lost(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    rows = rng.choice(POSES, 4, replace=False)
    for name in POSITION:
        table[name][rows] = 0.0
    return ("0, 0, 0",)


def sign_of_a_cell(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    name, row = str(rng.choice([_angle(table, rng), *POSITION])), int(rng.integers(POSES))
    table[name][row] *= -1.0
    return f"pose {row + 1}", f"pose: {row + 1}", f"--leave-out {row + 1}", name


def places_of_columns(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    """Columns with their names, which mean the same anywhere."""
    for name in rng.permutation(list(table)).tolist():
        table[name] = table.pop(name)
    return ()


def rows_shuffled(table: Table, rng: np.random.Generator) -> tuple[str, ...]:
    order = rng.permutation(POSES)
    table.update({name: column[order] for name, column in table.items()})
    return "ascend", "backwards"


CHANGES: tuple[Change, ...] = (
    unit_of_positions, unit_of_an_axis, unit_of_angles, unit_of_an_angle, unit_of_loads, sign, order_of_columns,
    order_of_rows, seam, zero, coupled, stale, lost,
    sign_of_a_cell, places_of_columns, rows_shuffled,
)  # fmt: skip


@cache
def healthy(arm: str) -> tuple[Table, str]:
    """The columns of an arm's healthy measurements, half of them with a load, and the file beside them."""
    rig = synthetic.load_arm(shipped_arms()[arm])
    truth = of_its_stiffness(arm, synthetic.GroundTruth.random(rig, SEED))
    load = np.where(np.arange(POSES) % 2 == 0, 0.0, LOAD_KG.get(arm, 0.0663))
    q = synthetic.random_poses(rig, POSES, SEED + 1)
    with TemporaryDirectory() as folder:
        data = synthetic.simulate(rig, truth, q, load, NOISE_M, SEED + 2)
        table, beside, _ = synthetic.write(Path(folder) / "healthy", data, "synthetic")
        rows = np.loadtxt(table, delimiter=",", skiprows=1)
        names = table.read_text().splitlines()[0].split(",")
        return dict(zip(names, rows.T, strict=True)), beside.read_text()


def fitted(arm: str, table: Table, folder: Path, file: str = "") -> tuple[int, str, Array | None]:
    """Exit code of `fit`, what it says, and where its model sees the tip (m) at random angles; `file`: the arm's text
    in place of the shipped one."""
    lines = [",".join(table), *(",".join(f"{cell:.9g}" for cell in row) for row in zip(*table.values(), strict=True))]
    (folder / "data.csv").write_text("\n".join(lines) + "\n")
    (folder / "data.toml").write_text(healthy(arm)[1])
    (path := folder / "arm.toml").write_text(file)
    given = ("--arm", path if file else arm, "-o", model := folder / "model.toml", "--all")
    code, *said = run_command("fit", folder / "data.csv", *given)
    words = re.sub(r"\s+", " ", " ".join(said))
    if code:
        return code, words, None
    low, high = 0.9 * np.array([(joint.lower, joint.upper) for joint in load_arm(arm).joints]).T
    q = np.random.default_rng(1).uniform(low, high, (POSES, len(low)))
    return code, words, solve_equilibrium(load_model(model), poses_of(q)).tcp


@cache
def right(arm: str) -> Array:
    with TemporaryDirectory() as folder:
        code, said, tips = fitted(arm, healthy(arm)[0], Path(folder))
    assert tips is not None, (code, said)
    return tips


def assert_not_silent(arm: str, found: tuple[int, str, Array | None], words: tuple[str, ...]) -> None:
    code, said, tips = found
    assert code in (0, 2), said
    if tips is not None and error_stats(tips - right(arm)).rms > NOISE_M:
        assert any(word in said for word in words), said


@pytest.mark.slow
@pytest.mark.usefixtures("one_step_folds")
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("seed", seeds(1, 12))
def test_a_change_is_refused_or_named_or_without_effect(change: Change, seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([seed, CHANGES.index(change)])
    arm = ARMS[(seed + CHANGES.index(change)) % len(ARMS)]
    table = {name: column.copy() for name, column in healthy(arm)[0].items()}
    words = change(table, rng)
    assert_not_silent(arm, fitted(arm, table, tmp_path), words)


ARM_CHANGES: dict[str, tuple[Callable[[str], str], str]] = {
    "lengths in metres": (lambda text: scaled_arm(text, r"\w+_mm", 1e-3), "lengths"),
    "lengths in micrometres": (lambda text: scaled_arm(text, r"\w+_mm", 1e3), "_mm = "),
    "masses in kilograms": (lambda text: scaled_arm(text, "mass_g", 1e-3), "masses"),
    "masses in milligrams": (lambda text: scaled_arm(text, "mass_g", 1e3), "weighs"),
    **{
        f"gravity {of}": (partial(re.sub, r"(gravity_m_per_s2 = ).*", rf"\g<1>[{of}]"), "gravity")
        for of in ("0, 0, 9.81", "9.81, 0, 0", "0, -9.81, 0", "0, 0, -9810", "0, 0, -981", "0, 0, -1", "0, 0, 0")
    },
}
"""Changes of an arm file, and what names them."""


@pytest.mark.slow
@pytest.mark.usefixtures("one_step_folds")
@pytest.mark.parametrize("kind", ARM_CHANGES)
@pytest.mark.parametrize("seed", seeds(1, len(ARMS)))
def test_so_is_one_of_an_arm_file(kind: str, seed: int, tmp_path: Path) -> None:
    change, word = ARM_CHANGES[kind]
    arm = ARMS[(seed + [*ARM_CHANGES].index(kind)) % len(ARMS)]
    text = shipped_arms()[arm].read_text()
    assert change(text) != text
    assert_not_silent(arm, fitted(arm, healthy(arm)[0], tmp_path, change(text)), (word,))


def swapped(_told: Array, read: Array, k: int) -> None:
    read[:, [k, k - 1]] = read[:, [k - 1, k]]


def older_zeros(told: Array, read: Array, _k: int) -> None:
    for angles in (told, read):
        angles[:, 1], angles[:, 2] = 90.0 - angles[:, 1], angles[:, 2] + 90.0


def both(change: Callable[[Array], Array]) -> Callable[[Array, Array, int], None]:
    """A change of what is commanded and of what is read."""

    def made(told: Array, read: Array, _k: int) -> None:
        told[:], read[:] = change(told), change(read)

    return made


RECORDINGS: dict[str, tuple[Callable[[Array, Array, int], object], str]] = {
    "sign": (
        lambda _, read, k: np.negative(read[:, k], out=read[:, k]),
        "{joint} turns against its command|beyond its limits",
    ),
    "turn": (lambda _, read, k: np.add(read[:, k], 360.0, out=read[:, k]), "{joint} reads a full turn"),
    "frozen": (lambda _, read, k: read.__setitem__((slice(None), k), 20.0), "{joint} stands still"),
    "not read": (lambda _, read, k: read.__setitem__((3, k), np.nan), "without a number"),
    "swapped": (swapped, "{joint} follows the command of|beyond its limits"),
    "radians": (both(np.radians), "--angle-unit rad"),
    "counts": (both(lambda angles: 2048.0 + angles * 4096.0 / 360.0), "counts"),
    "older zeros": (older_zeros, "before June 2025"),
}
"""Changes of angles (R, n), deg, commanded and read at rests, of a joint or of all; a pattern that names it."""


@pytest.mark.long
@pytest.mark.parametrize("kind", RECORDINGS)
@pytest.mark.parametrize("seed", seeds(1, 12))
def test_so_is_one_of_a_recording(kind: str, seed: int, tmp_path: Path) -> None:
    (change, words), arm, rng = RECORDINGS[kind], load_arm("so101"), np.random.default_rng([seed, 32])
    low, high = np.degrees([(joint.lower, joint.upper) for joint in arm.joints]).T
    true, k, out = rng.uniform(0.9 * low, 0.9 * high, (16, arm.dof)), int(rng.integers(arm.dof)), tmp_path / "poses.csv"
    true[0, 1:3] = 0.95 * low[1], 0.95 * high[2]
    change(told := true.copy(), read := true.copy(), k)
    folder = written(tmp_path / "recorded", told, read - told)
    code, *said = run_command("import", "lerobot", folder, "--arm", "so101", "-o", out)
    if code == 0 and is_near(np.genfromtxt(out, delimiter=",", names=True), true):
        if np.array_equal(told, read):
            return
        _, *said = run_command("checkup", folder, "--arm", "so101")
    assert re.search(words.format(joint=arm.joints[k].name), re.sub(r"\s+", " ", " ".join(said))), said


def is_near(table: Array, angles: Array) -> bool:
    """Whether a table has these angles (R, n), deg, within 0.3."""
    found = np.stack([table[f"q{j}_deg"] for j in range(1, angles.shape[1] + 1)], axis=1)
    return found.shape == angles.shape and np.allclose(found, angles, rtol=0.0, atol=0.3)
