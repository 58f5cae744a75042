"""Starts a simulated board as a subprocess of the daemon, for operation without hardware."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from lrm_math.errors import LrmError
from lrmd.config import Config
from lrmd.ramp.parent import die_with_parent

ENDS_WITH_US = partial(die_with_parent, signal.SIGTERM)
"""Run in the child: a daemon that is killed leaves no board behind, as a process of nobody's."""

OWN_STATE = "simulated"
"""Folder in the state directory: the pose of the real arm is not that of a simulated one, nor is its model."""


@contextmanager
def simulated_board(config: Config, speed: float = 1.0, *options: str) -> Iterator[Config]:
    """Runs `lrmd-board` on a private pty; yields the configuration with its port, and with a state directory of its
    own. Raises `LrmError` if it fails."""
    servo_names = (*config.arm.joint_names, *(name for name, _ in config.arm.auxiliary_servos))
    channels = ",".join(f"{s.name}={s.channel}" for s in config.servos if s.name in servo_names)
    with tempfile.TemporaryDirectory(prefix="lrmd-") as folder:
        port = Path(folder) / "board"
        command = [sys.executable, "-m", "lrmd.sim.process", "--link", str(port), "--arm", config.arm_file]
        command += [
            "--channels",
            channels,
            "--speed",
            str(speed),
            "--osc-hz",
            str(config.link.oscillator_hz),
            *_springs(config),
            *options,
        ]
        # in a group of its own: Ctrl-C ends the daemon first, which then ends the board
        board = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=ENDS_WITH_US, process_group=0)
        try:
            if board.stdout is None or not board.stdout.readline():
                raise LrmError(f"the simulated board ended with exit code {board.wait()}")
            link = config.link.model_copy(update={"port": str(port)})
            yield replace(config, link=link, state=config.state / OWN_STATE)
        finally:
            board.terminate()
            board.wait()


def _springs(config: Config) -> list[str]:
    """The springs of the configuration as options."""
    return [
        f"--spring={name}={spring.stiffness_nm_per_rad}:{spring.damping_nm_s_per_rad}:{spring.friction_nm}"
        for name, spring in config.simulation.spring.items()
    ]
