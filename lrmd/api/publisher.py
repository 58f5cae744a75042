"""Publications of the daemon: builds its messages from the controller and the shared memory, and schedules them.

The ramp's lateness is a histogram, from which percentiles and coarser buckets follow. Events come in bounded numbers: a
rate limit and a ring per code, so that no kind of event displaces the others.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict, deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import Any

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.effects import marked
from lrmd.api.supervisor import ChildProcess
from lrmd.config import SECOND, Config
from lrmd.control.arming_pose import stored_angles
from lrmd.control.requests import Controller
from lrmd.control.skill_run import SkillReport
from lrmd.control.state import ControllerEvent, RequestResult
from lrmd.ik.deployed_model import DeployedModel
from lrmd.messages.codec import Header, HeaderSource
from lrmd.messages.control import (
    Event,
    FaultsState,
    FieldPart,
    GravityState,
    InfoState,
    JointsState,
    MetricsState,
    ModeState,
    ObstacleState,
    ReloadReply,
    Reply,
    SceneState,
    ThermalState,
)
from lrmd.messages.skills import SkillState
from lrmd.ramp.shared_memory import BUCKET_NS, NO_MODEL, NOMINAL, SharedRecords

EDGES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 40, 50, 60, 80, 100, 120, 160, 200, 250, 300, 400, 511)
"""Upper edges of the coarse buckets, in fine ones, roughly logarithmic; the last bucket of either kind is open."""
BURST, WINDOW = 10, SECOND
"""Events of one code that pass within a window (ns) which begins with the first of them."""
KEPT_EVENTS = 500
"""Events kept of each code."""


@dataclass(frozen=True)
class Lateness:
    """Tick counts per fine bucket of `width_us`; the last bucket has no upper edge.

    `measured_us`: the largest lateness reported; the counts may be a tick ahead of it.
    """

    counts: tuple[int, ...]
    width_us: float
    measured_us: float

    @property
    def ticks(self) -> int:
        """Total number of ticks."""
        return sum(self.counts)

    @property
    def largest_us(self) -> float:
        """Largest lateness, at least the lower edge of the last non-empty bucket; 0 without ticks."""
        last = max((bucket for bucket, count in enumerate(self.counts) if count), default=0)
        return max(self.measured_us, last * self.width_us)

    def percentile_us(self, share: float) -> float:
        """Upper edge (us) of the fine bucket of quantile `share`; `largest_us` if that is the open one, 0 if empty."""
        ticks, seen = self.ticks, 0
        if not ticks:
            return 0.0
        for bucket, count in enumerate(self.counts[:-1]):
            seen += count
            if count and seen >= share * ticks:
                return (bucket + 1) * self.width_us
        return self.largest_us

    def upper_us(self) -> list[float]:
        """Exclusive upper edges (us) of the coarse buckets but the last."""
        return [edge * self.width_us for edge in EDGES]

    def coarse(self) -> list[int]:
        """Ticks per coarse bucket; the last one is open."""
        return [sum(self.counts[a:b]) for a, b in zip((0, *EDGES), (*EDGES, len(self.counts)), strict=True)]


class StatePublisher:
    """`states`: builders of the state messages, by key; `boot_id`: of this start; `model`: path in use;
    `gravity`: in use (m/s²)."""

    def __init__(
        self, config: Config, controller: Controller, shared: SharedRecords, ramp: ChildProcess, ik: ChildProcess,
        boot_id: str,
    ) -> None:  # fmt: skip
        self._config, self._controller, self._shared = config, controller, shared
        self._ramp, self._ik = ramp, ik
        self.gravity = config.arm.gravity
        self.model = "nominal" if config.model is None else str(config.model)
        self.boot_id, self._header = boot_id, HeaderSource(boot_id).next
        self._published_at = 0
        self._published: tuple[Any, ...] = ()
        self._skill_published: SkillReport | None = None
        self.states: dict[str, Callable[[], Header]] = {
            "state/joints": self._joints,
            "state/mode": self._mode,
            "state/faults": self._faults,
            "state/thermal": self._thermal,
            "state/gravity": self._gravity,
            "state/scene": self._scene,
            "state/skill": self._skill,
            "state/metrics": self._metrics,
            "info": self._info,
        }

    def due(self, now: int) -> list[str]:
        """Keys of the states to publish at `now` (ns): joints always, others on change or every second."""
        c = self._controller
        keys = ["state/joints"]
        published = (c.mode, c.why, tuple(c.faults), c.lease and c.lease.holder, c.report.link, c.troubles, c.stops)
        due = now - self._published_at >= SECOND
        if due or published != self._published:
            self._published = published
            keys += ["state/mode", "state/faults"]
        if due or c.skill_report != self._skill_published:
            self._skill_published = c.skill_report
            keys.append("state/skill")
        if due:
            self._published_at = now
            keys += ["state/thermal", "state/gravity", "state/scene", "state/metrics", "info"]
        return keys

    def reply(self, tail: str, result: RequestResult) -> Reply:
        """The reply to a request that was carried out."""
        lease = result.lease
        return Reply(
            **self._header(tail), mode=self._controller.mode.value, stops=self._controller.stops,
            seconds=result.seconds,
            lease=None if lease is None else lease.token, lease_ms=None if lease is None else self._config.lease / 1e6,
            model_sha256=self._model_sha256, unchecked=result.unchecked, skill=result.skill,
        )  # fmt: skip

    def reloaded(self, tail: str, deployed: DeployedModel) -> ReloadReply:
        """The reply to a request that changed the model."""
        field_file = deployed.field
        field = None
        if field_file is not None:
            field = FieldPart(
                effect=marked(field_file.effect), speaks_share=field_file.speaks, outside_share=field_file.outside
            )
        return ReloadReply(
            **self._header(tail), model=deployed.path, model_sha256=deployed.sha256,
            left_out=list(deployed.uncompensated),
            field=field, tip_moves_m=None if deployed.moved is None else deployed.moved.largest,
            tip_moves_rms_m=None if deployed.moved is None else deployed.moved.rms,
            motion_model=self._motion_model, motion_sha256=self._motion_sha256,
        )  # fmt: skip

    @property
    def _motion_model(self) -> str | None:
        motion_model = self._controller.motion
        return None if motion_model is None else motion_model.path

    @property
    def _motion_sha256(self) -> str:
        motion_model = self._controller.motion
        return "" if motion_model is None else motion_model.sha256

    @property
    def _model_sha256(self) -> str:
        accepted = self._shared.values.model
        return "" if accepted in (NOMINAL, NO_MODEL) else accepted.decode()

    def event(self, e: ControllerEvent) -> Event:
        """The message of an event."""
        return Event(**self._header("event"), code=e.code, level=e.level, text=e.text, detail=e.detail)

    def _joints(self) -> JointsState:
        c, names = self._controller, list(self._config.names)
        report, position = c.report, c.position
        return JointsState(
            **self._header("state/joints"), names=names, q_rad=c.angles(position),
            target_rad=c.angles(c.targets), pulse_us=[p / 1000 for p in position],
            on=[bool(report.outputs >> i & 1) for i in range(len(names))], moving=report.moving,
            remaining_s=report.remaining * self._config.tick / SECOND,
        )  # fmt: skip

    def _mode(self) -> ModeState:
        c = self._controller
        return ModeState(
            **self._header("state/mode"), mode=c.mode.value, why=c.why, since_mono_ns=c.since,
            holder=c.lease.holder if c.lease else None, link=c.report.link.name.lower(), payload_kg=c.payload,
            payload_centre_m=list(c.load_at), stops=c.stops, troubles=c.troubles,
        )  # fmt: skip

    def _faults(self) -> FaultsState:
        return FaultsState(**self._header("state/faults"), faults=list(self._controller.faults.values()))

    def _thermal(self) -> ThermalState:
        thermal, power = self._controller.thermal, self._controller.motion_record
        return ThermalState(
            **self._header("state/thermal"), names=list(self._config.names), temperature_c=list(thermal.temperature),
            tau_nm=list(thermal.tau), level=[thermal.model.level(T).name.lower() for T in thermal.temperature],
            hot_in_s=[None if math.isinf(s) else s for s in thermal.time_to_hot],
            powered_s=power.powered_s, powered_at_c=power.powered_at_c,
        )  # fmt: skip

    def _gravity(self) -> GravityState:
        gravity = self._controller.gravity
        return GravityState(
            **self._header("state/gravity"), gravity_m_per_s2=list(self.gravity),
            source="model" if gravity.used is None else "told", age_s=gravity.age_s(time.monotonic_ns()),
        )  # fmt: skip

    def _scene(self) -> SceneState:
        now = time.monotonic_ns()
        obstacles = [
            ObstacleState(
                name=name, owner=obstacle.owner, age_s=(now - obstacle.at) / SECOND,
                left_s=None if obstacle.until is None else max(0, obstacle.until - now) / SECOND,
            )
            for name, obstacle in self._controller.obstacles.known.items()
        ]  # fmt: skip
        return SceneState(**self._header("state/scene"), obstacles=obstacles)

    def _skill(self) -> SkillState:
        c = self._controller
        return SkillState(**self._header("state/skill"), **asdict(c.skill_report), stops=c.stops)

    def _metrics(self) -> MetricsState:
        report, duty = self._controller.report, self._shared.values.duty
        late = Lateness(tuple(self._shared.lateness), BUCKET_NS / 1000, report.max_late_ns / 1000)
        p50, p99, p999 = (late.percentile_us(share) for share in (0.5, 0.99, 0.999))
        return MetricsState(
            **self._header("state/metrics"), ticks=late.ticks, skipped=report.skipped, late_upper_us=late.upper_us(),
            late_counts=late.coarse(), late_p50_us=p50, late_p99_us=p99, late_p999_us=p999,
            late_max_us=late.largest_us, realtime=report.realtime, duty=duty, frames_sent=report.sent,
            frames_acknowledged=report.acknowledged, bad_frames=report.bad_frames, board_errors=report.board_errors,
            reconnects=report.reconnects, ramp_starts=self._ramp.starts, ik_starts=self._ik.starts,
        )  # fmt: skip

    def _info(self) -> InfoState:
        config, stored = self._config, self._controller.stored
        still = bool(stored and stored.still and not self._controller.fallen.bits)
        limits = [sorted((s.angle(s.lowest), s.angle(s.highest))) for s in config.servos]
        rates = [
            (high - low) / (s.highest - s.lowest) * config.step / config.tick * SECOND
            for s, (low, high) in zip(config.servos, limits, strict=True)
        ]
        return InfoState(
            **self._header("info"), robot=config.robot, arm=config.arm.name, version=version("lrm-arm"),
            names=list(config.names), joints=config.dof, limits_rad=limits, rate_rad_per_s=rates,
            tables_rad=[list(s.table.angle) for s in config.servos],
            tables_us=[[p * 1e6 for p in s.table.pulse] for s in config.servos],
            tick_ms=config.tick / 1e6, step_us=config.step / 1e3, count_us=config.clock.count_s * 1e6,
            pwm_hz=1.0 / (COUNTS_PER_PERIOD * config.clock.count_s), oscillator_hz=config.clock.oscillator_hz,
            lease_ms=config.lease / 1e6, command_ms=config.command / 1e6,
            model=self.model if self._model_sha256 else None, model_sha256=self._model_sha256,
            motion_model=self._motion_model, motion_sha256=self._motion_sha256,
            shaping=config.motion.shaping, within_m=config.motion.within_mm * 1e-3,
            stored_rad=stored_angles(config, stored), stored_still=still,
        )  # fmt: skip


@dataclass
class _Window:
    start: int
    count: int = 0
    last: ControllerEvent | None = None


class EventThrottle:
    """Passes the first `BURST` events of a code in a `WINDOW`; of the others the last, at its end, with their count."""

    def __init__(self) -> None:
        self._windows: dict[str, _Window] = {}

    def passes(self, event: ControllerEvent, now: int) -> bool:
        """Whether an event may be published at `now` (ns); if not, it is counted."""
        window = self._windows.setdefault(event.code, _Window(now))
        window.count += 1
        if window.count > BURST:
            window.last = event
        return window.last is None

    def due(self, now: int) -> list[ControllerEvent]:
        """The last event of each window that has ended, if it was not passed; with the `count` of those like it."""
        ended = [code for code, window in self._windows.items() if now - window.start >= WINDOW]
        windows = [self._windows.pop(code) for code in ended]
        return [_with_count(w.last, w.count - BURST) for w in windows if w.last is not None]


def _with_count(last: ControllerEvent, count: int) -> ControllerEvent:
    if count == 1:
        return last
    text = f"{last.text} (the last of {count} in {WINDOW // SECOND} s that are not listed)"
    return replace(last, text=text, detail={**last.detail, "count": count})


class EventRing:
    """The last `KEPT_EVENTS` packed events of each code."""

    def __init__(self) -> None:
        ring = partial(deque[tuple[int, bytes]], maxlen=KEPT_EVENTS)
        self._rings: defaultdict[str, deque[tuple[int, bytes]]] = defaultdict(ring)
        self._number = 0

    def add(self, code: str, data: bytes) -> None:
        """Keeps a packed event; the oldest of its code may go."""
        self._number += 1
        self._rings[code].append((self._number, data))

    def all(self) -> list[bytes]:
        """The kept events of all codes, oldest first."""
        return [data for _, data in sorted(entry for ring in self._rings.values() for entry in ring)]
