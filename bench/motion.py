"""`lrm-ident motion` beside `mujoco.sysid` (MuJoCo 4.0): held-out error, parameters against truth, time; in one run.

Two kinds of arms, each recorded twice: both tools fit the first recording, and predict the second, of other moves.

- Simulated SO-101s of the independent world (`validation.motion.world`), encoders and commands at 30 Hz. mujoco.sysid
  gets the arm's MJCF and, of every joint, the true stiffness; it fits armature, damping, dry friction, zero and delay.
- mujoco.sysid's own arm with position servos (of its tests), simulated by MuJoCo: the model that it fits is the truth.
  Encoders of 12 bits at 30 Hz. It fits armature and damping; stiffness is given. The data are simulated twice: at the
  step of its fit, so that the errors of both integrations cancel, and at a sixteenth of it, as an arm moves in time.

The model of motion starts anew at each move, of 6 s at most, mujoco.sysid's at each episode of 24 s.

`python -m bench.motion [--only so101|own] [--episodes N] [--json FILE]`; mujoco.sysid: extra `bench`.
"""

from __future__ import annotations

import argparse
import importlib
import io
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.moves import moves_of
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_math.arm.arm import Arm, JointLimits
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.model.model import model_of
from lrm_math.motion.loads import reference_inertia
from validation.lerobot_dataset import FPS, Recording, encoder_readings
from validation.motion.cases import FIRST, MotionCase, arm_of
from validation.motion.world import STIFF_NM_PER_RAD, driven, hand

STEP_S, FINER, ITERATIONS, MADE = 1.0 / FPS / 16.0, 16, 8, 2
"""s of MuJoCo's step, and times that data's is finer; iterations of its fit at most; episodes of 24 s of a recording,
if no other number is given."""
CASES = ("coulomb friction", "play")
OWN_ARMATURE, OWN_DAMPING = (0.5, 0.4, 0.3, 0.2, 0.1), (1.0, 0.8, 0.6, 0.4, 0.2)


@dataclass(frozen=True)
class MotionScore:
    """One tool on one arm: error at unseen moves (deg RMS), that of frequency and damping (RMS, relative), s of a fit.

    `named`: what it says is missing.
    """

    tool: str
    arm: str
    held_out_deg: float
    frequency: float
    damping: float
    seconds: float
    named: str


@dataclass(frozen=True)
class MotionTask:
    """An arm, two recordings of it, and its true natural frequencies (Hz) and damping ratios, (n,).

    `xml`: its MJCF with position servos of given stiffness. `free`: what mujoco.sysid fits of every joint. `links`:
    inertia of each joint in the middle of all ranges but for its armature (kg m²).
    """

    name: str
    arm: Arm
    seen: Recording
    unseen: Recording
    frequency: Array
    damping: Array
    stiffness: Array
    xml: str
    free: tuple[str, ...]
    servo_damping: Array
    links: Array


def module(name: str) -> Any:
    """A module of the extra `bench`, imported when it is needed."""
    return importlib.import_module(name)


def frames(made: Recording) -> LeRobotFrames:
    """As read from a dataset."""
    return LeRobotFrames(np.radians(made.action), np.radians(made.state), made.t, made.episode.astype(np.int64))


def ours(task: MotionTask) -> MotionScore:
    """`motion fit` and `motion auto`, the best model on the other recording."""
    begun = time.perf_counter()
    study = MotionStudy.of(moves_of(frames(task.seen), task.arm, Path("seen"))).fit().auto()
    seconds = time.perf_counter() - begun
    other = moves_of(frames(task.unseen), task.arm, Path("unseen")).along(study.model)
    squares = []
    for joint, data in enumerate(other.measured(study.model, range(task.arm.dof))):
        effects = study.model.of_joint(joint)
        values = np.array([[study.model.values[key] for effect in effects for key in effect.keys]])
        squares.append(np.mean(data.error(data.missed(effects, values))[0] ** 2))
    own = [
        np.array([study.model.values[f"servo_response.{place}.{name}"] for place in task.arm.joint_names])
        for name in ("frequency_Hz", "damping_ratio")
    ]
    named = ", ".join(one.effect.name for one in study.judged() if one.identified) or "-"
    return MotionScore("lrm-ident", task.name, _degrees(squares), *_off(task, *own), seconds, named)


def peer(task: MotionTask) -> MotionScore:
    """`mujoco.sysid.optimize` with its default optimiser, as its tests use it."""
    mujoco, sysid, logging = map(module, ("mujoco", "mujoco.sysid", "absl.logging"))
    logging.set_verbosity(logging.ERROR)
    begun = time.perf_counter()
    spec = mujoco.MjSpec.from_string(task.xml)
    labels = joint_labels(task.arm)
    params = sysid.ParameterDict()
    bounds = {"armature": (1e-4, 400.0), "damping": (1e-3, 1e5), "frictionloss": (0.0, 2000.0), "bias": (-0.5, 0.5),
              "delay": (0.0, 0.2)}  # fmt: skip
    scale = task.stiffness / (2.0 * np.pi * 4.0) ** 2
    guess = {"armature": scale, "damping": 2.0 * 0.7 * np.sqrt(task.stiffness * scale) - task.servo_damping,
             "frictionloss": 1e-3 * task.stiffness, "bias": np.zeros(task.arm.dof),
             "delay": np.full(task.arm.dof, 0.01)}  # fmt: skip
    for what in task.free:
        for joint, label in enumerate(labels):
            low, high = bounds[what]
            start = float(np.clip(guess[what][joint], low, high))
            params.add(sysid.Parameter(f"{label}.{what}", start, low, high, modifier=_modifier(label, what)))

    def shifted(
        params: Any, predicted: Any, measured: Any, model: Any, every: bool, *, state: Any
    ) -> tuple[Any, ...]:  # of the states: the sensors of a rollout stand one step late in time
        del model, every
        predicted = sysid.TimeSeries(state[:, 0], state[:, 1 : 1 + task.arm.dof], predicted.signal_mapping)
        names = [f"{label}_pos" for label in labels]
        given = {label: [params[f"{label}.{w}"].value[0] if w in task.free else 0.0 for w in ("delay", "bias")]
                 for label in labels}  # fmt: skip
        inside = measured.times >= predicted.times[0] + 0.25
        measured = sysid.TimeSeries(measured.times[inside], measured.data[inside], measured.signal_mapping)
        delays = {name: given[label][0] for name, label in zip(names, labels, strict=True)}
        predicted = sysid.apply_resample_and_delay(predicted, measured.times, 0.0, delays)
        data = predicted.data + np.array([given[label][1] for label in labels])
        return measured.data - data, sysid.TimeSeries(measured.times, data, measured.signal_mapping), measured

    residual = sysid.build_residual_fn(models_sequences=[_sequences(task, task.seen, spec)], modify_residual=shifted)
    with redirect_stdout(io.StringIO()):
        found, _ = sysid.optimize(params, residual, verbose=False, max_iters=ITERATIONS, x_scale="jac")
    seconds = time.perf_counter() - begun
    predict = sysid.build_residual_fn(models_sequences=[_sequences(task, task.unseen, spec)], modify_residual=shifted)
    missed = np.concatenate([np.ravel(part) for part in predict(found.as_vector(), found)[0]])
    armature, damping = (
        np.array([found[f"{label}.{what}"].value[0] for label in labels]) for what in ("armature", "damping")
    )
    J = armature + task.links
    omega = np.sqrt(task.stiffness / J)
    ratio = (damping + task.servo_damping) / (2.0 * omega * J)
    score = _off(task, omega / (2.0 * np.pi), ratio)
    return MotionScore("mujoco.sysid", task.name, _degrees([np.mean(missed**2)]), *score, seconds, "-")


def _modifier(label: str, what: str) -> Callable[[Any, Any], None] | None:
    if what in ("bias", "delay"):
        return None
    if what == "damping":  # a polynomial's coefficients, since MuJoCo 4.0
        return lambda spec, parameter: spec.joint(label).damping.__setitem__(0, parameter.value[0])
    return lambda spec, parameter: setattr(spec.joint(label), what, parameter.value[0])


def _sequences(task: MotionTask, made: Recording, spec: Any) -> Any:
    """The episodes; commands hold from frame to frame, at the simulation's steps."""
    sysid = module("mujoco.sysid")
    model = spec.compile()
    parts = [np.flatnonzero(made.episode == number) for number in np.unique(made.episode)]
    t = np.arange(len(parts[0])) / FPS
    fine = np.arange(round(t[-1] / STEP_S) + 1) * STEP_S
    held = np.minimum((fine * FPS + 1e-9).astype(int), len(t) - 1)
    commands = [sysid.TimeSeries(fine, np.radians(made.action[rows])[held]) for rows in parts]
    read = [sysid.TimeSeries.from_names(t, np.radians(made.state[rows]), model) for rows in parts]
    states = [sysid.create_initial_state(model, np.radians(made.action[rows[0]])) for rows in parts]
    return sysid.ModelSequences(task.name, spec, [f"episode{k}" for k in range(len(parts))], states, commands, read)


def _degrees(squares: list[Any]) -> float:
    return float(np.degrees(np.sqrt(np.mean(squares))))


def _off(task: MotionTask, frequency: Array, damping: Array) -> tuple[float, float]:
    """Relative errors, RMS over the joints."""
    parts = (frequency / task.frequency - 1.0, damping / task.damping - 1.0)
    return float(np.sqrt(np.mean(parts[0] ** 2))), float(np.sqrt(np.mean(parts[1] ** 2)))


def so101_task(case: MotionCase, seed: int, episodes: int) -> MotionTask:
    """An SO-101 with one cause hidden, its recordings, and its MJCF."""
    rng, arm = np.random.default_rng(seed), load_arm("so101")
    hidden, _ = arm_of(case, rng)
    seen, unseen = (driven([hidden], commands(rng, episodes), rng)[0] for _ in range(2))
    stiffness = np.full(arm.dof, STIFF_NM_PER_RAD)
    xml = with_servos(mjcf(model_of(arm, ())).text, joint_labels(arm), stiffness)
    free = ("armature", "damping", "frictionloss", "bias", "delay")
    name = f"SO-101, {case.name}"
    return MotionTask(
        name, arm, seen, unseen, hidden.frequency_hz, hidden.damping, stiffness, xml, free, np.zeros(arm.dof),
        reference_inertia(arm),
    )  # fmt: skip


def with_servos(xml: str, labels: tuple[str, ...], stiffness: Array) -> str:
    """An MJCF without contacts whose position servos have a stiffness and no damping, with a sensor for each joint."""
    mujoco = module("mujoco")
    spec = mujoco.MjSpec.from_string(xml)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for label, k in zip(labels, stiffness.tolist(), strict=True):
        servo = spec.add_actuator(name=f"{label}_servo", target=label, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=k)
        spec.add_sensor(
            name=f"{label}_pos", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=label
        )
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    spec.compile()
    return str(spec.to_xml())


def own_task(seed: int, episodes: int, finer: int) -> MotionTask:
    """The arm of mujoco.sysid's tests with the armatures and dampings of its other test, simulated by MuJoCo.

    `finer`: times that the data's step is shorter than that of the fit.
    """
    mujoco = module("mujoco")
    rng = np.random.default_rng(seed)
    source = (Path(mujoco.__file__).parent / "sysid" / "tests" / "conftest.py").read_text()
    xml = re.sub("<asset>.*?</asset>", "", source.split('ARM_XML = """\\\n')[1].split('"""')[0], flags=re.DOTALL)
    xml = xml.replace("<option ", f'<option timestep="{STEP_S!r}" ', 1)
    xml = re.sub("<(jointvel|jointactuatorfrc).*?/>", "", xml)  # encoders alone
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "own.xml"
        path.write_text(xml)
        imported = [sys.executable, "-m", "lrm_ident", "arm", "import", str(path), "-o", str(path.with_suffix(".toml"))]
        subprocess.run(imported, check=True, capture_output=True)
        arm = load_arm(str(path.with_suffix(".toml")))
    spec = mujoco.MjSpec.from_string(xml)
    for number, (armature, damping) in enumerate(zip(OWN_ARMATURE, OWN_DAMPING, strict=True)):
        spec.joint(f"joint{number + 1}").armature = armature
        spec.joint(f"joint{number + 1}").damping[0] = damping
    model = spec.compile()
    links = _inertia_in_the_middle(model, arm) - np.array(OWN_ARMATURE)
    model.opt.timestep = STEP_S / finer
    seen, unseen = (_simulated(model, rng, episodes) for _ in range(2))
    stiffness, braked = np.array([400.0] * 4 + [200.0]), np.array([40.0] * 4 + [20.0])
    J = np.array(OWN_ARMATURE) + links
    omega = np.sqrt(stiffness / J)
    ratio = (braked + np.array(OWN_DAMPING)) / (2.0 * omega * J)
    names, name = ("armature", "damping"), "its own arm" if finer == 1 else f"its own arm, {finer} times finer"
    return MotionTask(name, arm, seen, unseen, omega / (2.0 * np.pi), ratio, stiffness, xml, names, braked, links)


def _inertia_in_the_middle(model: Any, arm: Arm) -> Array:
    """(n,), diagonal of MuJoCo's mass matrix in the middle of all ranges (kg m²)."""
    mujoco = module("mujoco")
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:] = JointLimits.of(arm).middle
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    return np.diag(M).copy()


def _simulated(model: Any, rng: np.random.Generator, episodes: int) -> Recording:
    """What MuJoCo's arm does in episodes of teleoperation."""
    mujoco = module("mujoco")
    told = np.radians(encoder_readings(np.degrees(commands(rng, episodes)[:, 0]), rng))
    data, out = mujoco.MjData(model), []
    for episode in told:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = episode[0]
        for number, row in enumerate(episode):
            out.append(data.qpos.copy())
            data.ctrl[:] = row
            while data.time < (number + 1) / FPS - 1e-9:
                mujoco.mj_step(model, data)
    read = encoder_readings(np.degrees(np.array(out)), rng)
    N = told.shape[1]
    t, number_of = np.tile(np.arange(N) / FPS, len(told)), np.repeat(np.arange(len(told)), N)
    return Recording(np.degrees(told).reshape(-1, told.shape[2]), read, t, number_of)


def commands(rng: np.random.Generator, episodes: int) -> Array:
    """(E, 1, N, 5), rad, of a hand that leads one arm."""
    return np.stack([hand(rng)[None] for _ in range(episodes)])


def main() -> None:
    """Prints the scores, and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", default="", help="so101 or own")
    parser.add_argument("--episodes", type=int, default=MADE, help="of 24 s, of each recording")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    tasks: list[Callable[[], MotionTask]] = []
    if given.only != "so101":
        tasks += [lambda finer=finer: own_task(9, given.episodes, finer) for finer in (1, FINER)]  # type: ignore[misc]
    if given.only != "own":
        chosen = [next(case for case in FIRST if case.name == name) for name in CASES]
        tasks += [lambda case=case, k=k: so101_task(case, k, given.episodes) for k, case in enumerate(chosen)]  # type: ignore[misc]
    rows = []
    for make in tasks:
        task = make()
        mine, theirs = ours(task), peer(task)
        for one in (mine, theirs):
            rows.append(asdict(one))
            errors = f"frequency {100 * one.frequency:.2f} %, damping {100 * one.damping:.2f} %"
            print(f"{one.arm}, {one.tool}: held out {one.held_out_deg:.4f} deg RMS, {errors}, {one.seconds:.1f} s, "
                  f"identified: {one.named}", flush=True)  # fmt: skip
        ratios = [
            getattr(theirs, key) / getattr(mine, key) for key in ("held_out_deg", "frequency", "damping", "seconds")
        ]
        print(f"{task.name:28} theirs over ours: " + ", ".join(f"{ratio:.2f}" for ratio in ratios), flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
