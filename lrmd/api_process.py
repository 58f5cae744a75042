"""The api process: zenoh on one side, the ramp's orders and reports on the other, and the core between them."""

from __future__ import annotations

import os
import secrets
import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import structlog
import zenoh

from lrm_math.errors import FileError, LrmError
from lrmd import ik_process, ramp_process, store
from lrmd.config import Config
from lrmd.core import Core, Done, Happening, Refused
from lrmd.gravity import torques_of
from lrmd.ik_process import IkSetup
from lrmd.lease import LeaseError
from lrmd.mailbox import BUCKET_NS, Shared
from lrmd.messages import (
    ArmRequest,
    DisarmRequest,
    ErrorReply,
    EstopCommand,
    Event,
    FaultEntry,
    FaultsState,
    Header,
    HoldRequest,
    InfoState,
    JogRequest,
    JointsState,
    LeaseRequest,
    Message,
    MessageError,
    MetricsState,
    ModeState,
    MoveRequest,
    RelaxRequest,
    Reply,
    ResetRequest,
    ThermalState,
    pack,
    unpack,
)
from lrmd.metrics import percentile
from lrmd.notify import notify, watchdog_s
from lrmd.ramp_core import Board
from lrmd.ramp_process import RampSetup
from lrmd.shared_fd import SharedFd
from lrmd.states import Mode, NotAllowed
from lrmd.supervisor import Child, GivenUp
from lrmd.writer import Writer
from lrmd.zenoh_session import key, router

SECOND = 1_000_000_000
PERIOD = SECOND // 50
STUCK = SECOND // 2
"""ns without a tick, or within one query, after which a process is taken for stuck and started anew."""
START_TIME = 5 * SECOND
IK_STUCK = 5 * SECOND
KEPT_EVENTS = 500

REQUESTS: dict[str, type[Message]] = {
    "rpc/lease": LeaseRequest,
    "rpc/arm": ArmRequest,
    "rpc/move": MoveRequest,
    "rpc/hold": HoldRequest,
    "rpc/relax": RelaxRequest,
    "rpc/disarm": DisarmRequest,
    "rpc/reset_fault": ResetRequest,
}
COMMANDS: dict[str, type[Message]] = {"cmd/target": MoveRequest, "cmd/jog": JogRequest}


def error_reply(error: LrmError) -> ErrorReply:
    """What a client is told of an error."""
    match error:
        case Refused():
            return ErrorReply(code=error.code, msg=str(error), retryable=error.retryable, detail=error.detail)
        case NotAllowed():
            return ErrorReply(code="wrong_mode", msg=str(error), detail={"mode": error.mode.value})
        case LeaseError():
            return ErrorReply(code="lease", msg=str(error), retryable=True)
        case MessageError():
            return ErrorReply(code="bad_message", msg=str(error))
        case _:
            return ErrorReply(code="error", msg=str(error))


class Api:
    """One daemon. `speed`: how much faster than time a simulated board lives."""

    def __init__(self, config: Config, speed: float = 1.0) -> None:
        self._config = config
        self._log = structlog.get_logger().bind(robot=config.robot)
        self._boot_id = secrets.token_hex(8)
        self._seq: dict[str, int] = {}
        self._lock = threading.RLock()
        self._shared = Shared.create()
        self._estop = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._events: deque[bytes] = deque(maxlen=KEPT_EVENTS)
        self._pending: deque[Happening] = deque()
        memory = SharedFd(self._shared.descriptor)
        link = config.link
        self._ramp = Child(
            "ramp", ramp_process.run,
            RampSetup(Board.of(config), link.port, link.baud, config.tick, config.realtime_priority, speed, memory,
                      SharedFd(self._estop)),
        )  # fmt: skip
        self._ik = Child("ik", ik_process.run, IkSetup(config.robot, config.zenoh, memory))
        now = time.monotonic_ns()
        self._core = Core(config, torques_of(config.arm), self._load(), _no_guard, now, time.time_ns())
        self._writer = Writer(config.state, self._writing)
        self._stopping = threading.Event()
        self._tick_seen, self._ticked_at = 0, now
        self._saved_at, self._saved_what = 0, None  # type: tuple[int, Any]
        self._slow_at = 0
        self._told: tuple[Any, ...] = ()

    # ---- its life

    def run(self) -> int:
        """Runs until it is told to stop. Returns the exit code."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: self._stopping.set())
        now = time.monotonic_ns()
        self._shared.post(self._core.order)
        self._ramp.start(now)
        try:
            with zenoh.open(router(self._config.zenoh)) as session:
                self._session = session
                self._ik.start(now)
                self._declare(session)
                self._wait_for_ramp()
                notify("READY=1\nSTATUS=ready, disarmed")
                self._log.info("ready", boot_id=self._boot_id, port=self._config.link.port)
                self._loop()
                notify("STOPPING=1")
        except GivenUp as error:
            self._log.error("given_up", text=str(error))
            return 1
        finally:
            self._ramp.stop()
            self._ik.stop()
            self._save(time.monotonic_ns(), at_once=True)
            self._writer.close()
        self._log.info("stopped")
        return 0

    def _loop(self) -> None:
        watchdog = watchdog_s()
        sign_of_life = int((watchdog or 2.0) / 4 * SECOND)
        due, alive_at = time.monotonic_ns(), 0
        while not self._stopping.is_set():
            now = time.monotonic_ns()
            with self._lock:
                self._cycle(now)
            if now - alive_at >= sign_of_life and now - self._ticked_at < STUCK:
                alive_at = now
                notify(f"WATCHDOG=1\nSTATUS={self._core.mode}")
            due = max(due + PERIOD, now)
            self._stopping.wait((due - time.monotonic_ns()) / SECOND)

    def _cycle(self, now: int) -> None:
        core = self._core
        report = self._shared.report()
        if report is not None:
            core.observe(report, now)
            if report.tick != self._tick_seen:
                self._tick_seen, self._ticked_at = report.tick, now
        core.tick(now)
        self._shared.post(core.order)
        self._watch_processes(now)
        self._publish_joints(now)
        self._publish_slow(now)
        self._flush()
        self._save(now)

    def _wait_for_ramp(self) -> None:
        deadline = time.monotonic() + START_TIME / SECOND
        while self._shared.report() is None and time.monotonic() < deadline and not self._ramp.ended():
            time.sleep(0.002)

    def _watch_processes(self, now: int) -> None:
        ended = self._ramp.ended()
        if ended is None and now - self._ticked_at > STUCK and now - self._ramp.started_at > START_TIME:
            ended = f"no tick for {(now - self._ticked_at) / SECOND:.1f} s"
            self._ramp.kill()
        if ended is not None:
            self._happened("ramp_died", "error", f"the ramp process ended ({ended}); starting it anew")
            self._ramp.start(now)
            self._ticked_at = now
        ended = self._ik.ended()
        busy = self._shared.ik[0]
        if ended is None and busy and now - busy > IK_STUCK:
            ended = f"one query took more than {IK_STUCK // SECOND} s"
            self._ik.kill()
        if ended is not None:
            self._happened("ik_died", "warning", f"the ik process ended ({ended}); starting it anew")
            self._shared.ik[0] = 0
            self._ik.start(now)

    # ---- what survives

    def _load(self) -> store.Saved | None:
        folder = self._config.state
        try:
            folder.mkdir(parents=True, exist_ok=True)
            return store.load(folder)
        except FileError as error:
            self._happened("state_damaged", "error", f"{error}; it is set aside, and the pose is unknown")
            try:
                store.set_aside(folder)
            except OSError as fault:
                self._happened("state_damaged", "error", f"it cannot be set aside either ({fault.strerror})")
        except OSError as error:
            self._happened("state_not_saved", "error", f"{folder}: {error.strerror}")
        return None

    def _save(self, now: int, at_once: bool = False) -> None:
        core = self._core
        what = (core.mode, core.position, core.report.moving)
        moving = core.report.moving and self._saved_what is not None and self._saved_what[2]
        wait = self._config.save if moving else 0
        grown_old = now - self._saved_at > 60 * SECOND
        if at_once or grown_old or (what != self._saved_what and now - self._saved_at >= wait):
            self._saved_at, self._saved_what = now, what
            state = core.saved(time.time_ns())
            core.stored = state
            self._writer.put(state)

    def _writing(self, error: FileError | None) -> None:
        with self._lock:
            if error is None:
                self._happened("state_saved", "info", "the state can be saved again")
            else:
                self._happened("state_not_saved", "error", f"{error}; after a crash the pose will be an older one")

    # ---- zenoh

    def _declare(self, session: zenoh.Session) -> None:
        robot = self._config.robot
        best_effort: dict[str, Any] = {"congestion_control": zenoh.CongestionControl.DROP, "express": True}
        self._publishers = {
            tail: session.declare_publisher(key(robot, tail), **best_effort)
            for tail in ("state/joints", "state/mode", "state/faults", "state/thermal", "state/metrics", "info")
        }
        for tail in REQUESTS:
            session.declare_queryable(key(robot, tail), self._answering(tail))
        for tail in COMMANDS:
            session.declare_subscriber(key(robot, tail), self._obeying(tail))
        session.declare_subscriber(key(robot, "cmd/estop"), self._on_estop)
        session.declare_queryable(key(robot, "rpc/estop"), self._on_estop_query)
        session.declare_queryable(key(robot, "rpc/events"), self._on_events)
        for tail in self._publishers:
            session.declare_queryable(key(robot, tail), self._answering_state(tail))
        session.liveliness().declare_token(key(robot, "alive/lrmd"))

    def _answering(self, tail: str) -> Callable[[zenoh.Query], None]:
        kind, own = REQUESTS[tail], key(self._config.robot, tail)

        def answer(query: zenoh.Query) -> None:
            with query:
                if str(query.key_expr) != own:
                    text = f"ask {own} itself; requests to many at once are not carried out"
                    query.reply_err(pack(ErrorReply(code="wildcard", msg=text)))
                    return
                try:
                    request = unpack(kind, query.payload.to_bytes() if query.payload else b"")
                    reply = self._carry_out(tail, request)
                except LrmError as error:
                    query.reply_err(pack(error_reply(error)))
                except Exception as error:
                    self._log.exception("internal_error", key=own)
                    query.reply_err(pack(ErrorReply(code="internal", msg=f"{type(error).__name__}: {error}")))
                else:
                    query.reply(own, pack(reply))

        return answer

    def _carry_out(self, tail: str, request: Message) -> Reply:
        with self._lock:
            now = time.monotonic_ns()
            self._look(now)
            done = self._core.handle(request, now)
            self._shared.post(self._core.order)
            self._flush()
            return self._reply(tail, done)

    def _look(self, now: int) -> None:
        report = self._shared.report()
        if report is not None:
            self._core.observe(report, now)

    def _reply(self, tail: str, done: Done) -> Reply:
        lease = done.lease
        return Reply(
            **self._header(tail), mode=self._core.mode.value, seconds=done.seconds,
            lease=None if lease is None else lease.token,
            lease_ms=None if lease is None else self._config.lease / 1e6,
        )  # fmt: skip

    def _obeying(self, tail: str) -> Callable[[zenoh.Sample], None]:
        kind = COMMANDS[tail]

        def obey(sample: zenoh.Sample) -> None:
            try:
                self._carry_out(tail, unpack(kind, sample.payload.to_bytes()))
            except LrmError as error:
                reply = error_reply(error)
                with self._lock:
                    self._happened("refused", "warning", f"{tail}: {reply.msg}", {"code": reply.code, **reply.detail})
                    self._flush()
            except Exception:
                self._log.exception("internal_error", key=tail)

        return obey

    def _on_estop(self, sample: zenoh.Sample) -> None:
        self._stop_everything(sample.payload.to_bytes())

    def _on_estop_query(self, query: zenoh.Query) -> None:
        with query:
            self._stop_everything(query.payload.to_bytes() if query.payload else b"")
            query.reply(query.key_expr, pack(Reply(**self._header("rpc/estop"), mode=Mode.ESTOP.value)))

    def _stop_everything(self, data: bytes) -> None:
        """Rings the ramp first; reading who asked comes after, and nothing in the message can stop the stop."""
        os.eventfd_write(self._estop, 1)
        try:
            why = unpack(EstopCommand, data).why
        except LrmError:
            why = "a message that cannot be read"
        with self._lock:
            self._core.estop(time.monotonic_ns(), why)
            self._shared.post(self._core.order)
            self._flush()

    def _on_events(self, query: zenoh.Query) -> None:
        with query:
            for event in list(self._events):
                query.reply(query.key_expr, event)

    def _answering_state(self, tail: str) -> Callable[[zenoh.Query], None]:
        own = key(self._config.robot, tail)

        def answer(query: zenoh.Query) -> None:
            with query:
                try:
                    with self._lock:
                        message = self._states()[tail](time.monotonic_ns())
                    query.reply(own, pack(message))
                except Exception as error:
                    self._log.exception("internal_error", key=own)
                    query.reply_err(pack(ErrorReply(code="internal", msg=f"{type(error).__name__}: {error}")))

        return answer

    # ---- what it publishes

    def _header(self, tail: str) -> dict[str, Any]:
        seq = self._seq[tail] = self._seq.get(tail, 0) + 1
        return {"boot_id": self._boot_id, "seq": seq, "t_mono_ns": time.monotonic_ns(), "t_wall_ns": time.time_ns()}

    def _publish_joints(self, now: int) -> None:
        self._publishers["state/joints"].put(pack(self._joints(now)))

    def _publish_slow(self, now: int) -> None:
        core = self._core
        told = (core.mode, core.why, tuple(core.faults), core.lease and core.lease.holder, core.report.link)
        due = now - self._slow_at >= SECOND
        if due or told != self._told:
            self._told = told
            for tail in ("state/mode", "state/faults"):
                self._publishers[tail].put(pack(self._states()[tail](now)))
        if due:
            self._slow_at = now
            for tail in ("state/thermal", "state/metrics", "info"):
                self._publishers[tail].put(pack(self._states()[tail](now)))

    def _states(self) -> dict[str, Callable[[int], Header]]:
        return {
            "state/joints": self._joints,
            "state/mode": self._mode,
            "state/faults": self._faults,
            "state/thermal": self._thermal,
            "state/metrics": self._metrics,
            "info": self._info,
        }

    def _joints(self, now: int) -> JointsState:
        core, names = self._core, list(self._config.names)
        report, position = core.report, core.position
        return JointsState(
            **self._header("state/joints"), names=names, q_rad=core.angles(position),
            target_rad=core.angles(core.targets), pulse_us=[p / 1000 for p in position],
            on=[bool(report.outputs >> i & 1) for i in range(len(names))], moving=report.moving,
            remaining_s=report.remaining * self._config.tick / SECOND,
        )  # fmt: skip

    def _mode(self, now: int) -> ModeState:
        core = self._core
        return ModeState(
            **self._header("state/mode"), mode=core.mode.value, why=core.why, since_mono_ns=core.since,
            holder=core.lease.holder if core.lease else None, link=core.report.link.name.lower(),
            payload_kg=core.payload,
        )  # fmt: skip

    def _faults(self, now: int) -> FaultsState:
        faults = [FaultEntry(code=f.code, text=f.text, since_mono_ns=f.since) for f in self._core.faults.values()]
        return FaultsState(**self._header("state/faults"), faults=faults)

    def _thermal(self, now: int) -> ThermalState:
        core = self._core
        level = [core.thermal.heat(T).name.lower() for T in core.temperature]
        return ThermalState(
            **self._header("state/thermal"), names=list(self._config.names), temperature_c=list(core.temperature),
            tau_nm=list(core.tau), level=level,
        )  # fmt: skip

    def _metrics(self, now: int) -> MetricsState:
        report, counts, us = self._core.report, list(self._shared.lateness), BUCKET_NS / 1000
        p50, p99, p999 = (percentile(counts, share, us) for share in (0.5, 0.99, 0.999))
        return MetricsState(
            **self._header("state/metrics"), ticks=report.tick, skipped=report.skipped, late_p50_us=p50,
            late_p99_us=p99, late_p999_us=p999, late_max_us=report.latest / 1000, realtime=report.realtime,
            frames_sent=report.sent, frames_acknowledged=report.acknowledged, bad_frames=report.bad_frames,
            board_errors=report.board_errors, reconnects=report.reconnects, ramp_starts=self._ramp.starts,
            ik_starts=self._ik.starts,
        )  # fmt: skip

    def _info(self, now: int) -> InfoState:
        config, core = self._config, self._core
        limits = [sorted((s.angle(s.lowest), s.angle(s.highest))) for s in config.servos]
        rates = [
            (high - low) / (s.highest - s.lowest) * config.step / config.tick * SECOND
            for s, (low, high) in zip(config.servos, limits, strict=True)
        ]
        stored = core.stored
        return InfoState(
            **self._header("info"), robot=config.robot, arm=config.arm.name, version=version("lrm-arm"),
            names=list(config.names), joints=config.dof, limits_rad=limits, rate_rad_per_s=rates,
            tables_rad=[list(s.table.angle) for s in config.servos],
            tables_us=[[p * 1e6 for p in s.table.pulse] for s in config.servos],
            tick_ms=config.tick / 1e6, lease_ms=config.lease / 1e6, command_ms=config.command / 1e6,
            model=None if config.model is None else str(config.model), stored_rad=core.stored_angles(),
            stored_still=bool(stored and stored.still),
        )  # fmt: skip

    # ---- events

    def _happened(self, code: str, level: Any, text: str, detail: dict[str, Any] | None = None) -> None:
        self._pending.append(Happening(code, level, text, detail or {}))

    def _flush(self) -> None:
        """Logs and publishes what happened."""
        self._pending.extend(self._core.happenings)
        self._core.happenings.clear()
        while self._pending:
            h = self._pending.popleft()
            getattr(self._log, h.level)(
                h.code, text=h.text, **{f"_{k}" if k in ("event", "text") else k: v for k, v in h.detail.items()}
            )
            data = pack(Event(**self._header("event"), code=h.code, level=h.level, text=h.text, detail=h.detail))
            self._events.append(data)
            self._session.put(
                key(self._config.robot, f"event/{h.code}"), data, congestion_control=zenoh.CongestionControl.DROP
            )


def _no_guard(here: Any, there: Any) -> None:
    return None
