"""Inverse kinematics over zenoh: `python -m bench.ik_zenoh [SECONDS]`.

The daemon with the thesis's model (option 1) on the rover's arm, on a simulated board; the arm moves, and a client asks
200 times a second for poses that it can reach, by each method in turn: how long an answer takes, and how late the ticks
of the ramp are meanwhile.
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

from bench.daemon_rig import HOME, Figure
from bench.daemon_timing import QUERIES_PER_S, REST, Asking, punctual, queries, turn_to_and_fro
from bench.ik_calibrated import TABLE_B2
from lrmd.messages.control import pack, unpack
from lrmd.messages.kinematics import IkRequest
from lrmd.messages.zenoh_session import client
from tests.support.daemon_process import Place, running, wait_for

SECONDS = 60.0
Method = Literal["direct", "cube"]
METHODS: tuple[Method, ...] = ("direct", "cube")


def figures(method: Method, seconds: float) -> Iterator[Figure]:
    """One daemon, asked by one method."""
    with TemporaryDirectory() as folder:
        place = Place.make(Path(folder), {'# model = "/etc/lrm/model.toml"': f'model = "{TABLE_B2}"'})
        with running(place) as (_, daemon), place.rover() as rover, zenoh.open(client([place.endpoint])) as session:
            wait_for(lambda: rover.mode().link == "ready", "the board answers")
            plain = [unpack(IkRequest, question) for question in queries(rover)]
            questions = [pack(request.model_copy(update={"method": method})) for request in plain]
            with rover.control("bench"):
                rover.arm("given", HOME)
                rover.move(REST)
                with Asking(session, place, questions) as asking:
                    turn_to_and_fro(rover, seconds)
                time.sleep(1.1)
                metrics = rover.metrics()
            assert not {"ramp_died", "ik_died"} & set(daemon.codes()), "a process died meanwhile"
    yield from asking.figures(seconds)
    yield from punctual(metrics)


def main() -> None:
    """Prints a table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    table = Table(title=f"{QUERIES_PER_S} queries/s for {seconds:g} s", title_justify="left")
    for column in ("method", "what", "measured", "goal", "unit"):
        table.add_column(column, justify="right" if column in ("measured", "goal") else "left")
    for method in METHODS:
        for figure in figures(method, seconds):
            goal = "" if figure.goal is None else f"{figure.goal:g}"
            table.add_row(method, figure.what, f"{figure.values[0]:.4g}", goal, figure.unit)
        table.add_section()
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
