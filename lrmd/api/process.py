"""The api process: the loop that joins zenoh, the core, the ramp's orders and reports, the disk and systemd."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from contextlib import suppress
from typing import Any

import structlog
import zenoh

from lrm_math.errors import FileError, LrmError
from lrmd.api.model_reload import ModelInUse
from lrmd.api.publisher import Telling
from lrmd.api.supervisor import Child, GivenUp
from lrmd.api.systemd_notify import notify, watchdog_s
from lrmd.api.zenoh_server import Face, error_reply
from lrmd.config import Config
from lrmd.control.core import Core
from lrmd.control.events import Done, Happening, Level
from lrmd.errors import Refused
from lrmd.ik import process as ik_process
from lrmd.ik.process import IkSetup
from lrmd.messages.control import EstopCommand, Message, ReloadRequest, pack, unpack
from lrmd.messages.zenoh_session import router
from lrmd.persistence import state_file
from lrmd.persistence.background_writer import Writer
from lrmd.ramp import process as ramp_process
from lrmd.ramp.core import Board
from lrmd.ramp.process import RampSetup
from lrmd.ramp.shared_fd import SharedFd
from lrmd.ramp.shared_memory import Shared
from lrmd.safety.deployed_model import Deployed
from lrmd.thermal.joint_torques import torques_of

SECOND = 1_000_000_000
PERIOD = SECOND // 50
STUCK = SECOND // 2
"""ns without a tick after which the ramp process is taken for stuck and started anew: the board waits twice as long."""
START_TIME = 5 * SECOND
IK_STUCK = 5 * SECOND
SAVE_AT_LEAST = 60 * SECOND
KEPT_EVENTS = 500
ENDING = (signal.SIGTERM, signal.SIGINT)


class Api:
    """One daemon. `speed`: how much faster than time a simulated board lives."""

    def __init__(self, config: Config, speed: float = 1.0) -> None:
        self._config = config
        self._log = structlog.get_logger().bind(robot=config.robot)
        self._lock = threading.RLock()
        self._pending: deque[Happening] = deque()
        self._events: deque[bytes] = deque(maxlen=KEPT_EVENTS)
        self._shared = Shared.create()
        self._estop = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        memory = SharedFd(self._shared.descriptor)
        setup = RampSetup(
            Board.of(config, speed), config.link.port, config.link.baud, config.tick, config.realtime_priority, speed,
            memory, SharedFd(self._estop),
        )  # fmt: skip
        self._ramp = Child("ramp", ramp_process.run, setup)
        self._ik = Child("ik", ik_process.run, IkSetup(config, memory))
        now = time.monotonic_ns()
        self._model = ModelInUse(config, self._shared)
        guard = self._model.guard
        if guard is None:
            self._happened("no_shapes", "warning", f"{config.arm.name} has no collision shapes; no move is checked")
        stored, wall = self._load(), time.time_ns()
        self._core = Core(config, torques_of(config.arm), stored, guard or (lambda *_: None), now, wall)
        self._telling = Telling(config, self._core, self._shared, self._ramp, self._ik)
        self._writer = Writer(config.state, self._writing)
        self._stopping = self._reloading = False
        self._face: Face | None = None
        self._tick_seen, self._ticked_at = 0, now
        self._saved_at = 0
        self._saved: tuple[Any, ...] = ()
        self._told_at = 0
        self._told: tuple[Any, ...] = ()

    # ---- its life

    def run(self) -> int:
        """Runs until it is told to stop. Returns the exit code: 0, or 1 if a process cannot be kept alive."""
        # Handlers run in the middle of anything, also of a held lock: they may set a flag and nothing else.
        for number in ENDING:
            signal.signal(number, lambda *_: setattr(self, "_stopping", True))
        signal.signal(signal.SIGHUP, lambda *_: setattr(self, "_reloading", True))
        now = time.monotonic_ns()
        self._shared.post(self._core.order)
        self._ramp.start(now)
        try:
            with zenoh.open(router(self._config.zenoh)) as session:
                self._ik.start(now)
                self._wait_for_ramp()
                self._face = Face(session, self._config.robot, self, tuple(self._telling.states))
                notify("READY=1\nSTATUS=disarmed")
                self._log.info("ready", boot_id=self._telling.boot_id, port=self._config.link.port)
                self._loop()
                notify("STOPPING=1")
                self._face = None
        except (GivenUp, zenoh.ZError) as error:
            self._log.error("given_up", text=str(error).split(" at /")[0])
            return 1
        finally:
            self._ramp.stop()
            self._ik.stop()
            with self._lock:
                self._look(time.monotonic_ns())
                self._save(time.monotonic_ns(), at_once=True)
            self._writer.close()
            # Python puts the default handlers back while it ends, but leaves alone what is ignored.
            for number in ENDING:
                signal.signal(number, signal.SIG_IGN)
        self._log.info("stopped")
        return 0

    def _wait_for_ramp(self) -> None:
        deadline = time.monotonic() + START_TIME / SECOND
        while self._shared.report() is None and time.monotonic() < deadline and not self._ramp.ended():
            time.sleep(0.002)

    def _loop(self) -> None:
        sign_of_life = int((watchdog_s() or 2.0) / 4 * SECOND)
        due, alive_at = time.monotonic_ns(), 0
        while not self._stopping:
            now = time.monotonic_ns()
            if self._reloading:
                self._reloading = False
                with suppress(Refused):
                    self.reload()
            with self._lock:
                self._cycle(now)
            if now - alive_at >= sign_of_life and now - self._ticked_at < STUCK:
                alive_at = now
                notify(f"WATCHDOG=1\nSTATUS={self._core.mode}")
            due = max(due + PERIOD, now)
            time.sleep(max(0, due - time.monotonic_ns()) / SECOND)

    def reload(self) -> Deployed:
        """Takes the model's file as it is now. Raises `Refused` if it cannot be used: the model in use stays."""
        try:
            deployed = self._model.load()
        except LrmError as error:
            text = f"{error}; the model in use stays"
            with self._lock:
                self._happened("model_refused", "error", text)
                self._flush()
            raise Refused("model", text) from None
        with self._lock:
            self._core.way.guard = self._model.guard or self._core.way.guard
            self._happened("model_loaded", "info", f"model {deployed.path}", model_sha256=deployed.sha256)
            self._flush()
        return deployed

    def _cycle(self, now: int) -> None:
        self._look(now)
        self._core.tick(now)
        self._shared.post(self._core.order)
        self._watch_processes(now)
        self._publish(now)
        self._flush()
        self._save(now)

    def _look(self, now: int) -> None:
        report = self._shared.report()
        if report is not None:
            self._core.observe(report, now)
            if report.tick != self._tick_seen:
                self._tick_seen, self._ticked_at = report.tick, now

    def _watch_processes(self, now: int) -> None:
        silent = now - max(self._ticked_at, self._ramp.started_at)
        stuck = silent > (STUCK if self._ticked_at > self._ramp.started_at else START_TIME)
        self._keep_alive(self._ramp, f"no tick for {silent / SECOND:.1f} s" if stuck else None, "error", now)
        alive = self._shared.ik[0]
        stuck = 0 < alive < now - IK_STUCK
        if self._keep_alive(self._ik, f"no sign of life for {IK_STUCK // SECOND} s" if stuck else None, "warning", now):
            self._shared.ik[0] = 0

    def _keep_alive(self, child: Child, stuck: str | None, level: Level, now: int) -> bool:
        ended = child.ended() or stuck
        if ended is None:
            return False
        child.kill()
        self._happened(f"{child.name}_died", level, f"the {child.name} process ended ({ended}); starting it anew")
        child.start(now)
        return True

    # ---- what survives

    def _load(self) -> state_file.Saved | None:
        folder = self._config.state
        try:
            folder.mkdir(parents=True, exist_ok=True)
            return state_file.load(folder)
        except FileError as error:
            self._happened("state_damaged", "error", f"{error}; it is set aside, and the pose is unknown")
            try:
                state_file.set_aside(folder)
            except OSError as fault:
                self._happened("state_damaged", "error", f"it cannot be set aside either ({fault.strerror})")
        except OSError as error:
            self._happened("state_not_saved", "error", f"{folder}: {error.strerror}")
        return None

    def _save(self, now: int, at_once: bool = False) -> None:
        """Saves when something changed; while the arm moves, only so often."""
        core = self._core
        state = (core.mode, core.position, core.report.moving)
        still_moving = core.report.moving and bool(self._saved) and self._saved[2]
        wait = self._config.save if still_moving else 0
        changed = state != self._saved and now - self._saved_at >= wait
        if at_once or changed or now - self._saved_at > SAVE_AT_LEAST:
            self._saved_at, self._saved = now, state
            core.stored = core.saved(time.time_ns())
            self._writer.put(core.stored)

    def _writing(self, error: FileError | None) -> None:
        with self._lock:
            if error is None:
                self._happened("state_saved", "info", "the state can be saved again")
            else:
                self._happened("state_not_saved", "error", f"{error}; after a crash the pose will be an older one")

    # ---- what zenoh asks for, from its threads (see `face.Owner`)

    def carry_out(self, tail: str, request: Message) -> Message:
        """Carries out a request. Raises `LrmError` if it cannot."""
        if isinstance(request, ReloadRequest):
            deployed = self.reload()
            self._model.wait_for_ik(deployed)
            return self._telling.reloaded(deployed)
        with self._lock:
            now = time.monotonic_ns()
            self._look(now)
            done = self._core.handle(request, now)
            self._shared.post(self._core.order)
            self._flush()
            return self._telling.reply(tail, done)

    def refused(self, tail: str, error: LrmError) -> None:
        """A command that has nobody to reply to: an event tells why it was not carried out."""
        reply = error_reply(error)
        with self._lock:
            self._happened("refused", "warning", f"{tail}: {reply.msg}", why=reply.code)
            self._flush()

    def stop_everything(self, data: bytes) -> Message:
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
            return self._telling.reply("rpc/estop", Done())

    def state(self, tail: str) -> Message:
        """A state message, as of now."""
        with self._lock:
            return self._telling.states[tail]()

    def events(self) -> list[bytes]:
        """The last events, oldest first."""
        with self._lock:
            return list(self._events)

    # ---- what it says

    def _publish(self, now: int) -> None:
        if self._face is None:
            return
        core = self._core
        tails = ["state/joints"]
        told = (core.mode, core.why, tuple(core.faults), core.lease and core.lease.holder, core.report.link)
        due = now - self._told_at >= SECOND
        if due or told != self._told:
            self._told = told
            tails += ["state/mode", "state/faults"]
        if due:
            self._told_at = now
            tails += ["state/thermal", "state/metrics", "info"]
        for tail in tails:
            self._face.publish(tail, self._telling.states[tail]())

    def _happened(self, code: str, level: Level, text: str, **detail: Any) -> None:
        self._pending.append(Happening(code, level, text, detail))

    def _flush(self) -> None:
        """Logs what happened, keeps it, and publishes it."""
        self._pending.extend(self._core.happenings)
        self._core.happenings.clear()
        while self._face is not None and self._pending:
            happening = self._pending.popleft()
            getattr(self._log, happening.level)(happening.code, text=happening.text, detail=happening.detail)
            data = pack(self._telling.event(happening))
            self._events.append(data)
            self._face.tell(happening.code, data)
