"""Inverse kinematics over zenoh: `python -m validation.daemon_performance.ik_queries [SECONDS] [QUERIES_PER_S]`.

The daemon with the thesis's model (option 1) on the rover's arm, on a simulated board; the arm moves, and a client asks
200 times a second (or as given) for poses that it can reach, by each method in turn: how long an answer takes, and how
late the ticks of the ramp are meanwhile.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import zenoh
from rich.console import Console
from rich.table import Table

from lrmd.messages.codec import pack, unpack
from lrmd.messages.kinematics import IkRequest
from lrmd.messages.zenoh_session import client
from tests.support.daemon.daemon_harness import HOME
from tests.support.daemon.daemon_process import DaemonSetup, running_daemon, wait_for
from validation.calibrated_ik import TABLE_B2
from validation.daemon_performance.measurement import PerformanceFigure
from validation.daemon_performance.timing import (
    QUERIES_PER_S,
    REST,
    QueryLoad,
    lateness_figures,
    reachable_queries,
    swing_joint6,
)

SECONDS = 60.0
Method = Literal["direct", "cube"]
METHODS: tuple[Method, ...] = ("direct", "cube")


def figures(method: Method, seconds: float, per_s: float) -> Iterator[PerformanceFigure]:
    """One daemon, asked by one method."""
    with TemporaryDirectory() as folder:
        setup = DaemonSetup.make(Path(folder), {'# model = "/etc/lrm/model.toml"': f'model = "{TABLE_B2}"'})
        with (
            running_daemon(setup) as (_, daemon),
            setup.rover() as rover,
            zenoh.open(client([setup.endpoint])) as session,
        ):
            wait_for(lambda: rover.mode().link == "ready", "the board answers")
            plain = [unpack(IkRequest, request) for request in reachable_queries(rover)]
            requests = [pack(request.model_copy(update={"method": method})) for request in plain]
            with rover.control("bench"):
                rover.arm("given", HOME)
                rover.move(REST)
                with QueryLoad(session, setup, requests, per_s) as load:
                    swing_joint6(rover, seconds)
                time.sleep(1.1)
                metrics = rover.metrics()
            assert not {"ramp_died", "ik_died"} & set(daemon.codes()), "a process died meanwhile"
    yield from load.figures(seconds)
    yield from lateness_figures(metrics)


def main() -> None:
    """Prints a table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    per_s = float(sys.argv[2]) if len(sys.argv) > 2 else QUERIES_PER_S
    table = Table(title=f"{per_s:g} queries/s for {seconds:g} s", title_justify="left")
    for column in ("method", "what", "measured", "goal", "unit"):
        table.add_column(column, justify="right" if column in ("measured", "goal") else "left")
    for method in METHODS:
        for figure in figures(method, seconds, per_s):
            goal = "" if figure.goal is None else f"{figure.goal:g}"
            table.add_row(method, figure.what, f"{figure.values[0]:.4g}", goal, figure.unit)
        table.add_section()
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
