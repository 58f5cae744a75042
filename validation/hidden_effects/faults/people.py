"""Faults of rows, files and the people who measure."""

from __future__ import annotations

import numpy as np

from validation.hidden_effects.faults.measurement import NOISE_M, HealthyMeasurement, SpoiledMeasurement


def healthy(taken: HealthyMeasurement) -> SpoiledMeasurement:
    return SpoiledMeasurement(taken.tcp)


def block(taken: HealthyMeasurement) -> SpoiledMeasurement:
    first, tcp = int(taken.rng.integers(20, len(taken.q) - 40)), taken.tcp.copy()
    rows = np.arange(first, first + int(taken.rng.integers(8, 18)))
    tcp[rows] = taken.tcp[rows - 1]
    return SpoiledMeasurement(tcp)


def swapped(taken: HealthyMeasurement) -> SpoiledMeasurement:
    tcp = taken.tcp.copy()
    for row in taken.rng.choice(len(tcp) - 1, 4, replace=False):
        tcp[[row, row + 1]] = tcp[[row + 1, row]]
    return SpoiledMeasurement(tcp)


def typed_wrongly(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """In four rows the sign of an angle was lost."""
    q, rows = taken.q.copy(), taken.rng.choice(len(taken.q), 4, replace=False)
    q[rows, taken.joint()] *= -1.0
    return SpoiledMeasurement(taken.tcp, q=q)


def whole_degrees(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """Angles were noted in whole degrees."""
    return SpoiledMeasurement(taken.tcp, q=np.radians(np.round(np.degrees(taken.q))))


def load_forgotten(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The load was not noted for the last third."""
    load, last = taken.load.copy(), len(taken.load) * 2 // 3
    load[last:] = 0.0
    return SpoiledMeasurement(taken.tcp, load=load, right=("payload@tool",))


def other_tool(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """From one pose on the last joint carries the target a quarter of a degree and some mm elsewhere."""
    after = np.arange(len(taken.q)) >= taken.moment()
    turned = taken.moved(taken.q.shape[1] - 2, np.radians(taken.rng.uniform(1.0, 2.0)) * after)
    return SpoiledMeasurement(turned, right=(f"change_point@joint{taken.q.shape[1] - 1}",))


def rounded_positions(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """Positions were written in half millimetres."""
    return SpoiledMeasurement(np.round(taken.tcp / 5e-4) * 5e-4)


def heavy_tails(taken: HealthyMeasurement) -> SpoiledMeasurement:
    noise = taken.rng.standard_t(3.0, taken.tcp.shape) / np.sqrt(3.0)
    return SpoiledMeasurement(taken.at(taken.q) + 0.3 * NOISE_M * noise)


def rows_sorted_afterwards(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A joint drifted, and somebody sorted the rows by the first joint: their order tells nothing any more."""
    joint, order = taken.joint(), np.argsort(taken.q[:, 0])
    tcp = taken.moved(joint, np.radians(taken.rng.uniform(0.8, 1.4)) * (taken.progress - 0.5))
    return SpoiledMeasurement(tcp[order], q=taken.q[order], load=taken.load[order])


def somebody_walks_by(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The table shakes while one pose in ten is measured."""
    shaken = (taken.rng.random(len(taken.q)) < 0.1)[:, None]
    return SpoiledMeasurement(taken.tcp + shaken * taken.rng.normal(scale=0.002, size=taken.tcp.shape))


def load_written_wrongly(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The load was put on a scale that shows twice as much."""
    return SpoiledMeasurement(taken.tcp, load=2.0 * taken.load, right=("payload@tool",))
