"""What the daemon says of itself: the state messages, each made from the core and the shared memory."""

from __future__ import annotations

import math
import secrets
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

from lrmd.api.supervisor import Child
from lrmd.config import Config
from lrmd.control.arming_pose import stored_angles
from lrmd.control.core import Core
from lrmd.control.events import Done, Happening
from lrmd.messages.control import (
    Event,
    FaultEntry,
    FaultsState,
    Header,
    InfoState,
    JointsState,
    MetricsState,
    ModeState,
    ReloadReply,
    Reply,
    ThermalState,
)
from lrmd.ramp.lateness import Lateness
from lrmd.ramp.shared_memory import BUCKET_NS, Shared
from lrmd.safety.deployed_model import Deployed

SECOND = 1_000_000_000


class Telling:
    """Makes messages; `states` by key. Counts the messages of every key, and carries this start's `boot_id`."""

    def __init__(self, config: Config, core: Core, shared: Shared, ramp: Child, ik: Child) -> None:
        self._config, self._core, self._shared = config, core, shared
        self._ramp, self._ik = ramp, ik
        self._seq: dict[str, int] = {}
        self.boot_id = secrets.token_hex(8)
        self.states: dict[str, Callable[[], Header]] = {
            "state/joints": self._joints,
            "state/mode": self._mode,
            "state/faults": self._faults,
            "state/thermal": self._thermal,
            "state/metrics": self._metrics,
            "info": self._info,
        }

    def _header(self, tail: str) -> dict[str, Any]:
        seq = self._seq[tail] = self._seq.get(tail, 0) + 1
        return {"boot_id": self.boot_id, "seq": seq, "t_mono_ns": time.monotonic_ns(), "t_wall_ns": time.time_ns()}

    def reply(self, tail: str, done: Done) -> Reply:
        """The answer to a request that was carried out."""
        lease = done.lease
        return Reply(
            **self._header(tail), mode=self._core.mode.value, seconds=done.seconds,
            lease=None if lease is None else lease.token,
            lease_ms=None if lease is None else self._config.lease / 1e6,
        )  # fmt: skip

    def reloaded(self, deployed: Deployed) -> ReloadReply:
        """The answer to a reload."""
        return ReloadReply(**self._header("rpc/reload"), model=deployed.path, model_sha256=deployed.sha256)

    def event(self, h: Happening) -> Event:
        """Something that happened."""
        return Event(**self._header("event"), code=h.code, level=h.level, text=h.text, detail=h.detail)

    def _joints(self) -> JointsState:
        core, names = self._core, list(self._config.names)
        report, position = core.report, core.position
        return JointsState(
            **self._header("state/joints"), names=names, q_rad=core.angles(position),
            target_rad=core.angles(core.targets), pulse_us=[p / 1000 for p in position],
            on=[bool(report.outputs >> i & 1) for i in range(len(names))], moving=report.moving,
            remaining_s=report.remaining * self._config.tick / SECOND,
        )  # fmt: skip

    def _mode(self) -> ModeState:
        core = self._core
        return ModeState(
            **self._header("state/mode"), mode=core.mode.value, why=core.why, since_mono_ns=core.since,
            holder=core.lease.holder if core.lease else None, link=core.report.link.name.lower(),
            payload_kg=core.payload,
        )  # fmt: skip

    def _faults(self) -> FaultsState:
        faults = [FaultEntry(code=f.code, text=f.text, since_mono_ns=f.since) for f in self._core.faults.values()]
        return FaultsState(**self._header("state/faults"), faults=faults)

    def _thermal(self) -> ThermalState:
        heat = self._core.heat
        return ThermalState(
            **self._header("state/thermal"), names=list(self._config.names), temperature_c=list(heat.temperature),
            tau_nm=list(heat.tau), level=[heat.model.heat(T).name.lower() for T in heat.temperature],
            hot_in_s=[None if math.isinf(s) else s for s in heat.hot_in],
        )  # fmt: skip

    def _metrics(self) -> MetricsState:
        report, late = self._core.report, self._lateness()
        p50, p99, p999 = (late.percentile_us(share) for share in (0.5, 0.99, 0.999))
        return MetricsState(
            **self._header("state/metrics"), ticks=late.ticks, skipped=report.skipped, late_upper_us=late.upper_us(),
            late_counts=late.coarse(), late_p50_us=p50, late_p99_us=p99, late_p999_us=p999,
            late_max_us=late.largest_us, realtime=report.realtime, duty=self._shared.duty, frames_sent=report.sent,
            frames_acknowledged=report.acknowledged, bad_frames=report.bad_frames, board_errors=report.board_errors,
            reconnects=report.reconnects, ramp_starts=self._ramp.starts, ik_starts=self._ik.starts,
        )  # fmt: skip

    def _lateness(self) -> Lateness:
        return Lateness(tuple(self._shared.lateness), BUCKET_NS / 1000, self._core.report.latest / 1000)

    def _info(self) -> InfoState:
        config, stored = self._config, self._core.stored
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
            tick_ms=config.tick / 1e6, lease_ms=config.lease / 1e6, command_ms=config.command / 1e6,
            model=None if config.model is None else str(config.model),
            model_sha256="" if config.model is None else self._shared.model.hex(),
            stored_rad=stored_angles(config, stored), stored_still=bool(stored and stored.still),
        )  # fmt: skip
