"""Trial of a model file in a process of its own, with bounds of memory and time: what passes it is cheap to load.

A model has to be plausible: its arm comes to rest, and within its limits, over a sample of its range. The process is
spawned: it holds no descriptor of the daemon's, neither zenoh's nor the port nor the shared memory.
"""

from __future__ import annotations

import math
import resource
import signal
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError, NoEquilibrium
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrmd.background import give_way
from lrmd.config import Config
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import DeployedModel, deploy_file
from lrmd.ik.service import solver_of
from lrmd.ramp.parent import die_with_parent
from lrmd.safety.collision_guard import Guard, guard_of
from lrmd.safety.stability import stability_of

MEMORY = 64 << 20
"""Bytes of address space for the file, beyond what the process and the nominal arm take."""
SECONDS, DEADLINE = 2, 8.0
"""s of computing time (the thesis's model takes 0.02), and until the answer, the start of the process included."""
TOO_LARGE, TOO_DEEP = f"takes more than {MEMORY >> 20} MB of memory", "nests too deeply"
LONGEST_REASON = 1000


def load_checked(config: Config, path: Path | None) -> tuple[DeployedModel, Guard | None]:
    """The model of a file (None: the nominal arm), and the guard with its sag. Raises `LrmError`: not to be used."""
    deployed = deploy_file(config, path)
    solver_of(config, deployed)
    try:
        check_comes_to_rest(config.arm, deployed.model)
    except LrmError as error:
        raise FileError(deployed.path, "", str(error)) from None
    return deployed, guard_of(
        config.arm, deployed.model if deployed.sha256 else None, stability_of(config, deployed.model)
    )


Trial = Callable[[Config, Path | None], object]
"""Loads and checks a model file; raises `LrmError`: not to be used. None: without one, takes as much memory."""


def check_in_trial(config: Config, path: Path | None, trial_of: Trial = load_checked) -> None:
    """Loads and checks a model file as the daemon would, in another process. Raises `LrmError`: not to be used."""
    ours, theirs = get_context("spawn").Pipe(duplex=False)
    trial = get_context("spawn").Process(
        target=run, args=(config, path, theirs, trial_of), name="lrmd-model", daemon=True
    )
    trial.start()
    theirs.close()
    try:
        answered = ours.poll(DEADLINE)
        reason = ours.recv_bytes(4 * LONGEST_REASON).decode() if answered else None
    except EOFError:
        trial.join(1.0)
        raise FileError(path, "", _ended(trial.exitcode)) from None
    finally:
        trial.kill()
        trial.join()
        ours.close()
    if reason is None:
        late = f"not checked within {DEADLINE:g} s, for lack of computing time; ask again"
        raise RequestError("busy", late, retryable=True)
    if reason:
        raise LrmError(reason)


def _ended(code: int | None) -> str:
    if code == -signal.SIGXCPU:
        return f"takes more than {SECONDS} s to check; a model file takes some hundredths"
    return f"cannot be checked: the process that did it ended ({code})"


def run(config: Config, path: Path | None, answer: Connection, trial_of: Trial) -> None:
    """Entry point of the process: sends an empty text for a model that can be used, else why it cannot."""
    die_with_parent()
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    give_way()
    trial_of(config, None)
    before = _limit(_address_space() + MEMORY)
    what = ""
    try:
        trial_of(config, path)
        reason = ""
    except LrmError as error:
        reason = str(error)
    except MemoryError:
        what = TOO_LARGE
    except RecursionError:
        what = TOO_DEEP
    resource.setrlimit(resource.RLIMIT_AS, before)
    if what:
        reason = str(FileError(path, "", what, "a model file is a few kB of names and numbers"))
    answer.send_bytes(" ".join(reason[:LONGEST_REASON].split()).encode())


def _limit(size: int) -> tuple[int, int]:
    """Limits this process; returns the earlier limits of its address space."""
    used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (int(used) + 1 + SECONDS, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (size, before[1]))
    return before


def _address_space() -> int:
    """Bytes of address space of this process."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


SAMPLES = 256
OVERSHOOT = 0.1
"""Share of a joint's range by which the arm may rest outside: it sags at the ends of its range, too."""


def check_comes_to_rest(arm: Arm, model: Model) -> None:
    """Raises `LrmError` if the unloaded arm, at a pose of the sample, rests far outside its limits or not at all."""
    lower, upper = (np.array([getattr(joint, side) for joint in arm.joints]) for side in ("lower", "upper"))
    q = lower + (upper - lower) * np.random.default_rng(0).random((SAMPLES, arm.dof))
    try:
        at_rest = solve_equilibrium(model, poses_of(q))
    except NoEquilibrium as error:
        why = str(error).partition(": ")[2]
        raise LrmError(f"no model of this arm: commanded to {_pose(q[error.poses[0] - 1])} deg, {why}") from None
    slots = [np.broadcast_to(at_rest.slots[k], SAMPLES) for k in model.chain.joint_slots]
    angles = np.stack(slots, axis=1) - [joint.theta for joint in arm.joints]
    outside = np.maximum(lower - angles, angles - upper) - OVERSHOOT * (upper - lower)
    row, joint = np.unravel_index(int(outside.argmax()), outside.shape)
    if not outside[row, joint] <= 0.0:
        low, high = math.degrees(lower[joint]), math.degrees(upper[joint])
        raise LrmError(
            f"no model of this arm: commanded to {_pose(q[row])} deg, {arm.joint_names[joint]} would rest at "
            f"{math.degrees(angles[row, joint]):.0f} deg; its limits are {low:g} to {high:g} deg"
        )


def _pose(q: Array) -> str:
    return " ".join(f"{angle:.0f}" for angle in np.degrees(q))
