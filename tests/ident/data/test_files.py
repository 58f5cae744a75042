"""Every file format: what is written is what is read."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import assume, given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.commanded_poses import directions
from lrm_ident.data.measurement_file.conventions import arm_for
from lrm_ident.data.measurement_file.load import load_measurements, load_poses, read_pose_feedback
from lrm_ident.data.measurement_file.write import csv_text, measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.study.model_history import model_text
from lrm_math.arm.arm import Arm, MimicJoint, Placement
from lrm_math.arm.arm_file import ArmFile, load_arm, read_arm, shipped_arms
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import model_of
from lrm_math.model.model_file import ModelFile, load_model, parameter_tables
from tests.support.random_arms import arms

finite = st.floats(-1e4, 1e4)


def as_file(arm: Arm) -> dict[str, object]:
    """The tables that describe an arm."""

    def placement(p: Placement) -> dict[str, float]:
        lengths = {f"{k}_mm": getattr(p, k) * 1e3 for k in "xyz"}
        return lengths | {f"{k}_deg": math.degrees(getattr(p, k)) for k in ("alpha", "beta", "gamma")}

    def follow(mimic: MimicJoint) -> dict[str, object]:
        leader = f"joint{mimic.leader + 1}"
        return {"joint": leader, "ratio": mimic.ratio, "offset_deg": math.degrees(mimic.offset)}

    frames = arm.frame_names
    return {
        "schema": "lrm/arm/1",
        "name": arm.name,
        "gravity_m_per_s2": list(arm.gravity),
        "base": placement(arm.base),
        "tool": placement(arm.tool),
        "joint": [
            {
                "theta_deg": math.degrees(j.theta),
                "d_mm": j.d * 1e3,
                "a_mm": j.a * 1e3,
                "alpha_deg": math.degrees(j.alpha),
                "limits_deg": [math.degrees(j.lower), math.degrees(j.upper)],
            }
            | ({} if j.extra_z is None else {"extra_z_mm": j.extra_z * 1e3})
            | ({} if mimic is None else {"follow": follow(mimic)})
            for _, j, mimic in arm.chain_order
        ],
        "body": [
            {
                "name": b.name,
                "mass_g": b.mass * 1e3,
                "com_mm": [c * 1e3 for c in b.com],
                "com_from": "near_end" if b.near_end else "frame",
                "frame": frames[b.frame],
                "loads_joint": b.loads_joint,
                "carries_payload": b.carries_payload,
            }
            for b in arm.bodies
        ],
    }


@pytest.mark.slow
@given(arms)
def test_arm_files(tmp_path_factory: pytest.TempPathFactory, arm: Arm) -> None:
    assume(1.3 < np.linalg.norm(arm.gravity) < 30.0)  # what a file may have
    path = tmp_path_factory.mktemp("arm") / "arm.toml"
    path.write_text(tomli_w.dumps(as_file(arm)))
    back = read_arm(path)
    assert back.link_places == arm.link_places
    for one, other in zip(arm.mimics, back.mimics, strict=True):
        assert (other.after, other.leader, other.ratio) == (one.after, one.leader, one.ratio)
        assert other.offset == pytest.approx(one.offset, abs=1e-15)
    assert [b.name for b in back.bodies] == [b.name for b in arm.bodies]
    for ours, theirs in zip(
        [*arm.joints, *(mimic.link for mimic in arm.mimics), arm.base, arm.tool, *arm.bodies],
        [*back.joints, *(mimic.link for mimic in back.mimics), back.base, back.tool, *back.bodies],
        strict=True,
    ):
        for name, value in vars(ours).items():
            if isinstance(value, float | tuple):
                np.testing.assert_allclose(getattr(theirs, name), value, rtol=1e-12, atol=1e-15)
            else:
                assert getattr(theirs, name) == value


@pytest.mark.parametrize("name", ["lrm-lab", "lrm-rover"])
def test_shipped_arms_survive_their_own_schema(name: str) -> None:
    path = shipped_arms()[name]
    text = path.read_text()
    import tomllib

    tables = ArmFile.model_validate(tomllib.loads(text))
    assert ArmFile.model_validate(tables.model_dump(by_alias=True, exclude_none=True)) == tables
    assert load_arm(name) == read_arm(path)


@pytest.mark.slow
@given(st.data())
def test_model_files(tmp_path_factory: pytest.TempPathFactory, lab: Arm, data: st.DataObject) -> None:
    effects = [e for name in ("offsets", "compliance", "backlash@joint2") for e in effects_at(lab, name)]
    empty = model_of(lab, effects)
    keys = data.draw(st.lists(st.sampled_from(empty.keys), unique=True))
    values = {key: data.draw(st.floats(-1.0, 1.0)) for key in keys}
    model = model_of(lab, effects, values)
    path = tmp_path_factory.mktemp("model") / "model.toml"
    tables = ModelFile(
        schema="lrm/model/1",
        arm="lrm-lab",
        effects=["offsets", "compliance", "backlash@joint2"],
        parameters={key: value / empty.parameter(key).si for key, value in values.items()},
        sigma=dict.fromkeys(keys, 0.1),
    )
    path.write_text(model_text(tables))
    back = load_model(path)
    assert back.arm == lab
    assert set(back.free) == {key for key in keys if not empty.parameter(key).scan}
    np.testing.assert_allclose(back.values, model.values, rtol=1e-15, atol=0)
    again = tables.model_copy(update={"parameters": parameter_tables(back)})
    path.write_text(model_text(again))
    np.testing.assert_allclose(load_model(path).values, model.values, rtol=1e-14, atol=0)


@pytest.mark.slow
@given(st.integers(0, 1000), st.integers(1, 12), st.booleans())
def test_measurement_files(
    tmp_path_factory: pytest.TempPathFactory, lab: Arm, seed: int, count: int, full: bool
) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.7, 1.7, (count, 6))
    pose = rng.permutation(100)[:count] + 1
    data = Measurements.of_tcp(
        Poses(
            q=q,
            payload=rng.choice([0.0, 0.0663], count),
            direction=directions(q, None),
            t=np.arange(count) * 15.0 if full else None,
            session=rng.integers(1, 3, count).astype(float) if full else None,
            temperature=rng.uniform(20, 40, count).round(2) if full else None,
        ),
        rng.uniform(-0.3, 0.3, (count, 3)),
        sd=rng.uniform(1e-4, 1e-3, count) if full else None,
        pose=pose,
        repeat_of=rng.choice(pose, count) if full else pose,
    )
    path = tmp_path_factory.mktemp("data") / "data.csv"
    path.write_text(measurements_csv(data))
    back = load_measurements(path, lab)
    np.testing.assert_allclose(back.poses.q, q, atol=1e-11)
    np.testing.assert_allclose(back.tcp, data.tcp, atol=1e-9)
    np.testing.assert_allclose(back.poses.payload, data.poses.payload, atol=1e-9)
    for name in ("pose", "repeat_of"):
        np.testing.assert_array_equal(getattr(back, name), getattr(data, name))
    for name in ("direction", "t", "session", "temperature"):
        ours, theirs = getattr(data.poses, name), getattr(back.poses, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_allclose(theirs, ours, atol=1e-9)
    if full:
        np.testing.assert_allclose(back.sd, data.sd, atol=1e-9)


@given(st.lists(st.tuples(finite, finite), min_size=1, max_size=20))
def test_tables_keep_their_digits(tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float]]) -> None:
    from lrm_ident.data.measurement_file.number_table import numbers_of, read_csv

    columns = np.array(rows)
    path = tmp_path_factory.mktemp("table") / "t.csv"
    path.write_text(csv_text([("a", columns[:, 0], 6), ("b_mm", columns[:, 1], 3)]))
    table = read_csv(path, ["b_mm"])
    np.testing.assert_allclose(numbers_of(table, "a"), columns[:, 0], atol=5.1e-7)
    np.testing.assert_allclose(numbers_of(table, "b_mm"), columns[:, 1], atol=5.1e-4)


def test_pose_files_need_angles_only(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("q6_deg,q5_deg,q4_deg,q3_deg,q2_deg,q1_deg\n6,5,4,3,2,1\n")
    poses = load_poses(path, lab)
    np.testing.assert_allclose(np.degrees(poses.q), [[1, 2, 3, 4, 5, 6]])
    np.testing.assert_array_equal(poses.payload, [0.0])


def test_directions_remember_the_last_move() -> None:
    q = np.array([[1.0, 0.0], [1.0, 0.0], [0.5, 0.0], [0.5, -1.0]])
    expected = [[1, 0], [1, 0], [-1, 0], [-1, -1]]
    np.testing.assert_array_equal(directions(q, np.zeros(2)), expected)
    np.testing.assert_array_equal(directions(q, None), [[0, 0], [0, 0], [-1, 0], [-1, -1]])


def test_the_rovers_tables_are_the_thesis(rover: Arm) -> None:
    assert [round(math.degrees(j.alpha)) for j in rover.joints] == [90, -90, 90, -90, 90, 0]
    assert [j.extra_z for j in rover.joints] == [None, 0.10351, None, 0.10775, None, None]
    assert (rover.base.x, rover.base.z, rover.tool.z) == (-0.034975, 0.23608, 0.13038)
    assert sum(b.mass for b in rover.bodies) == pytest.approx(0.722)
    assert {round(math.degrees(j.upper)) for j in rover.joints} == {100}
    assert dict(rover.auxiliary_servos)["gripper"].pulse == pytest.approx((580e-6, 1480e-6, 2380e-6))


def test_feedback_beside_commanded_poses_is_read_in_the_order_and_with_the_signs_of_the_arm(tmp_path: Path) -> None:

    arm, path = load_arm("lrm-lab"), tmp_path / "poses.csv"
    n = arm.dof
    names = [*(f"q{i}_deg" for i in range(1, n + 1)), *(f"q{i}_meas_deg" for i in range(1, n + 1))]
    path.write_text(f"{','.join(names)}\n{','.join(['1'] * n + [str(i) for i in range(1, n + 1)])}\n")
    order, sign = [2, 1, *range(3, n + 1)], [1, -1, *[1] * (n - 2)]
    path.with_suffix(".toml").write_text(f'schema = "lrm/measurements/1"\njoint_order = {order}\njoint_sign = {sign}\n')
    (feedback,), sd = read_pose_feedback(path, arm)
    assert sd is None
    np.testing.assert_allclose(np.degrees(feedback.values[0]), np.array(order) * sign)


def test_an_arm_file_beside_the_data_is_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(shipped_arms()["two-joint"], tmp_path / "mine.toml")
    (tmp_path / "data.csv").write_text("pose,q1_deg,q2_deg,x_mm,y_mm,z_mm\n1,0,0,1,2,3\n")
    (tmp_path / "data.toml").write_text('schema = "lrm/measurements/1"\narm = "mine.toml"\n')
    monkeypatch.chdir("/")
    name, arm = arm_for(tmp_path / "data.csv", None)
    assert (name, arm) == (str(tmp_path / "mine.toml"), load_arm("two-joint"))
