"""Command line of the daemon, `lrmd`. Imports inside `main` keep the child processes light."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lrm_math.command_line import INTERRUPTED, OneLineParser
from lrm_math.errors import LrmError
from lrm_math.stdout import os_error_words

if TYPE_CHECKING:
    from lrmd.config import Config

TEXT = """\
The daemon that owns a robot arm on RC servos: it has the serial link to the
servo board, changes every commanded pulse by at most 1 us per 6.5 ms tick (the
board rounds it to counts: 4.88 us at 50 Hz), publishes state on zenoh, and
moves the arm only on request. CONFIG is usually /etc/lrm/lrmd.toml.

  lrmd --config CONFIG               run (systemd does this)
  lrmd --config CONFIG --check       load what the start loads, report its
                                     errors, and stop
  lrmd --config CONFIG --undo        take the last deployed model back, where
                                     its file stops the start
  lrmd --simulated                   run the shipped configuration on a
                                     simulated board and arm
  lrmd --config CONFIG --simulated   run on a simulated board and arm instead
                                     of the port
"""


def run(config: Config, speed: float = 1.0) -> int:
    """Runs the daemon until SIGTERM; its exit code. The children load while this process does."""
    from lrmd.api.children import ChildProcesses
    from lrmd.persistence.sole_user import sole_user

    with sole_user(config.state), ChildProcesses(config, speed) as children:
        from lrmd.api.process import ApiProcess

        return ApiProcess(config, children).run()


def _check(file: Path, config: Config) -> int:
    """Loads what the start loads, and prints that it is in order. Raises `LrmError`."""
    from lrmd.api.start_check import check_start

    summary = check_start(config)
    try:
        print(f"{file}: in order; {summary}", flush=True)
    except OSError as error:  # such as a full disk behind `>`
        raise LrmError(os_error_words(error)) from None
    return 0


def main(argv: list[str] | None = None) -> int:
    """Runs the daemon. Exit code 0 after SIGTERM, 1 if a process cannot be kept alive, 2 for a bad configuration
    or a state directory that another daemon uses."""
    parser = OneLineParser("lrmd", description=TEXT, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, metavar="FILE", help="lrmd.toml; with --simulated the shipped one")
    parser.add_argument("--check", action="store_true", help="load what the start loads, and stop")
    undo = "take the last deployed model back, without a daemon; with 'motion' that of motion"
    parser.add_argument("--undo", nargs="?", const="model", choices=["model", "motion"], help=undo)
    parser.add_argument("--simulated", action="store_true", help="run on a simulated board instead of the port")
    parser.add_argument("--log-level", choices=["debug", "info", "warning", "error"], default="info")
    try:
        options = parser.parse_args(argv)
        if options.config is None and not options.simulated:
            parser.error("state the configuration with --config FILE, or run the shipped one with --simulated")
        from lrmd import log
        from lrmd.config import SHIPPED, load_config
        from lrmd.heap import return_freed_memory

        file = options.config or SHIPPED
        config = load_config(file)
        if options.config is None:  # its state directory is that of a rover, where only root may write
            home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
            config = replace(config, state=Path(home) / "lrmd")
        if options.check:
            return _check(file, config)
        if options.undo:
            from lrmd.persistence.deployed_models import DeployedVersions, ModelKind
            from lrmd.persistence.sole_user import sole_user

            with sole_user(config.state):
                print(DeployedVersions.of(config, ModelKind(options.undo)).undo_offline())
            return 0
        return_freed_memory()
        if options.simulated:
            from lrmd.sim.launch import simulated_board
        with simulated_board(config) if options.simulated else nullcontext(config) as used:
            log.set_up(options.log_level)
            return run(used)
    except LrmError as error:
        print(f"lrmd: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:  # while it starts: afterwards it is as SIGTERM
        print("lrmd: interrupted", file=sys.stderr)
        return INTERRUPTED
