"""The api process: the 50 Hz loop between zenoh, the controller, the ramp, the state file and systemd."""

from __future__ import annotations

import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import structlog
import zenoh

from lrm_math.errors import FileError, LrmError
from lrmd.api.children import ChildProcesses
from lrmd.api.deployed_motion import ActiveMotionModel
from lrmd.api.model_reload import ActiveModel
from lrmd.api.presence import IkProbe, Presence
from lrmd.api.publisher import EventRing, EventThrottle, StatePublisher
from lrmd.api.skill_questions import SkillQuestions
from lrmd.api.supervisor import ChildProcess, RestartLimitExceeded, silence
from lrmd.api.systemd_notify import notify, watchdog_s
from lrmd.api.zenoh_server import ZenohServer
from lrmd.config import SECOND, Config
from lrmd.control.motion_predictor import FinalLeg
from lrmd.control.requests import Controller
from lrmd.control.state import ControllerEvent, Level
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import DeployedModel
from lrmd.messages.codec import Header, Message, error_reply, pack
from lrmd.messages.control import (
    ArmRequest,
    DeployRequest,
    HoldRequest,
    JogRequest,
    LeaseRequest,
    MotionRequest,
    MoveRequest,
    PayloadRequest,
    ReloadRequest,
    Reply,
    UndeployRequest,
)
from lrmd.messages.surroundings import packed
from lrmd.messages.zenoh_session import own_client
from lrmd.persistence.state_file import BackgroundWriter, SaveSchedule, restored_state
from lrmd.ramp.shared_memory import ArmKnowledge, LoadRecord
from lrmd.safety.thermal_model import gravity_torques

PERIOD, STANDBY_PERIOD = SECOND // 50, 4 * SECOND // 50
"""ns between cycles: the longer one while the servos are off and nobody subscribes to the joints."""
LEAST_PAUSE = SECOND // 1000
"""ns: after a long cycle, the requests that waited come before the next one."""
RAMP_TIMEOUT = SECOND // 2
"""ns without a tick after which the ramp process is restarted: half of the board's own timeout."""
START_TIMEOUT = 20 * SECOND
SETTLING_TIME = SECOND // 10
"""ns, 15 ticks of the ramp: for the last order to be read before the next motion."""
IK_PAUSE = 10 * SECOND
"""ns until an ik process that does not start is tried again."""
IK_TIMEOUT, ROUTER_TIMEOUT = 15 * SECOND, 2 * SECOND
"""ns without a sign of life. One goal takes 0.1 s on a fast computer before its first cube: seconds beside floods."""
T = TypeVar("T")
STOP_SIGNALS = (signal.SIGTERM, signal.SIGINT)


class ApiProcess:
    """The daemon's main process."""

    def __init__(self, config: Config, children: ChildProcesses) -> None:
        self._config, self._children, self.boot_id = config, children, children.boot_id
        self._shared, self._ramp, self._ik, self._router = children.shared, children.ramp, children.ik, children.router
        self._log = structlog.get_logger().bind(robot=config.robot)
        self._lock = threading.RLock()
        self._pending: deque[ControllerEvent] = deque()
        self._throttle, self._events = EventThrottle(), EventRing()
        self._estops_seen = 0
        now = time.monotonic_ns()
        self._model = ActiveModel(config, self._shared)
        guard, stored = self._model.guard, restored_state(config, self._emit)
        torques = gravity_torques(config.arm, self._model.gravity)
        self._controller = Controller(config, torques, stored, guard, now, time.time_ns())
        self._motion = ActiveMotionModel(config, self._model)
        self._controller.motion = self._motion.predictor
        if self._controller.motion is None and config.motion.shaping != "off":
            text = f"shaping = '{config.motion.shaping}' shapes no move until a motion model is deployed"
            self._emit("no_motion_model", "info", text)
        if self._controller.unchecked:
            self._emit("no_shapes", "warning", f"{self._controller.unchecked}; no move is checked")
        self._publisher = StatePublisher(config, self._controller, self._shared, self._ramp, self._ik, self.boot_id)
        self._publisher.model, self._publisher.gravity = self._model.deployed.path, self._model.gravity
        self._writer = BackgroundWriter(config.state, self._on_write)
        self._stopping = self._reloading = self._was_ready = False
        self._ik_due = now
        self._server: ZenohServer | None = None
        self._presence: Presence | None = None
        self._questions: SkillQuestions | None = None
        self._tick_seen, self._ticked_at = 0, now
        self._saving = SaveSchedule(config.save)
        self._knowledge: ArmKnowledge | None = None
        self._load: LoadRecord | None = None
        self._obstacles = self._controller.obstacles

    def run(self) -> int:
        """Runs until SIGTERM or SIGINT. Returns the exit code: 0, or 1 if a process cannot be kept alive."""
        # Signal handlers may interrupt a section that holds the lock: they only set a flag.
        for number in STOP_SIGNALS:
            signal.signal(number, lambda *_: setattr(self, "_stopping", True))
        signal.signal(signal.SIGHUP, lambda *_: setattr(self, "_reloading", True))
        now = time.monotonic_ns()
        self._shared.write_order(self._controller.order)
        self._ramp.start(now)
        try:
            self._children.wait_for_router(self._config.zenoh.listen, START_TIMEOUT)
            with zenoh.open(own_client(self._config.zenoh)) as session:
                self._children.wait_for_ramp(START_TIMEOUT)
                self._server = ZenohServer(session, self._config.robot, self, tuple(self._publisher.states))
                self._questions = SkillQuestions(session, self._config.robot, self.boot_id, self._answered)
                self._presence = Presence(session, self._config.robot, self.boot_id)
                self._loop(IkProbe(session, self._config.robot))
                notify("STOPPING=1")
                self._server = None
        except (RestartLimitExceeded, zenoh.ZError) as error:
            self._log.error("given_up", text=str(error).split(" at /")[0])
            return 1
        finally:
            self._children.stop()
            with self._lock:
                self._observe(time.monotonic_ns())
                self._save(time.monotonic_ns(), at_once=True)
            self._writer.close()
            # Python puts the default handlers back while it ends, but leaves alone what is ignored.
            for number in STOP_SIGNALS:
                signal.signal(number, signal.SIG_IGN)
        self._log.info("stopped")
        return 0

    def _loop(self, probe: IkProbe) -> None:
        notify_every = int((watchdog_s() or 2.0) / 4 * SECOND)
        due, notified_at = time.monotonic_ns(), 0
        while not self._stopping:
            now = time.monotonic_ns()
            if self._reloading:
                self._reloading = False
                threading.Thread(target=self._reload_on_signal, daemon=True).start()
            with self._lock:
                self._cycle(now)
            if not self._was_ready and self._ready(probe, now):
                self._was_ready = True
                notify(f"READY=1\nSTATUS={self._controller.mode}")
                self._log.info("ready", boot_id=self.boot_id, port=self._config.link.port)
            if self._was_ready and now - notified_at >= notify_every and now - self._ticked_at < RAMP_TIMEOUT:
                notified_at = now
                notify(f"WATCHDOG=1\nSTATUS={self._controller.mode}")
            due = max(due + (STANDBY_PERIOD if self._was_ready and self._standing_by else PERIOD), now)
            time.sleep(max(LEAST_PAUSE, due - time.monotonic_ns()) / SECOND)

    @property
    def _standing_by(self) -> bool:
        unread = self._server is None or not self._server.has_subscriber("state/joints")
        return self._controller.mode is Mode.DISARMED and unread

    def _ready(self, probe: IkProbe, now: int) -> bool:
        """Whether all processes work: the ramp ticks, and the ik process has the model and answers."""
        probe.query(now)
        ik = probe.answered and self._shared.ik[0] > 0 and self._shared.values.ik_model == self._shared.values.model
        return ik and self._shared.read_report() is not None

    def _reload_on_signal(self) -> None:
        """Reads the model file again; in the next cycle if another model is being loaded."""
        try:
            self._adopt(self._model.load)
        except RequestError as error:
            self._reloading = self._reloading or error.code == "busy"

    def _loaded(self, load: Callable[[], T]) -> T:
        """What is loaded. Raises `RequestError` if it cannot be used: the model in use stays."""
        try:
            return load()
        except RequestError:
            raise
        except LrmError as error:
            text = f"{error}; the model in use stays"
            with self._lock:
                self._emit("model_refused", "error", text)
                self._flush()
            raise RequestError("model", text) from None

    def _adopt(self, load: Callable[[], DeployedModel]) -> DeployedModel:
        """Uses a model. Raises `RequestError` if it cannot be used."""
        deployed = self._loaded(load)
        with self._lock:
            self._publisher.model = deployed.path
            self._use_model("the new model", time.monotonic_ns())
            self._emit("model_loaded", "info", f"model {deployed.path}", model_sha256=deployed.sha256)
            self._flush()
        return deployed

    def _adopt_motion(self, load: Callable[[], None]) -> DeployedModel:
        """Uses a model of motion from the next motion on; the model of poses in use. Raises `RequestError`."""
        self._loaded(load)
        with self._lock:
            known = self._controller.motion = self._motion.predictor
            text = "no motion model: nothing is shaped" if known is None else f"motion model {known.path}"
            self._emit("model_loaded", "info", text, motion_sha256="" if known is None else known.sha256)
            self._flush()
        return self._model.deployed

    def _use_model(self, cause: str, now: int) -> None:
        """Guard and torques of the model as it is now."""
        self._publisher.gravity = self._model.gravity
        self._controller.motion_check.torques = gravity_torques(self._config.arm, self._model.gravity)
        if self._model.guard is not None:
            self._controller.adopt_guard(self._model.guard, now, cause)

    def _follow_gravity(self, now: int) -> None:
        """Adopts another direction of gravity where one is due."""
        gravity = self._controller.gravity
        if not gravity.due(now):
            return
        before, down = gravity.used, gravity.adopt(now)
        self._model.under_gravity(down)
        self._use_model("the new direction of gravity", now)
        if before is None:
            self._emit("gravity_known", "info", "the arm's model follows the direction of gravity that it is told")
        elif down is None:
            text = f"no direction of gravity for {gravity.age_s(now):.0f} s: the model's own is used again"
            self._emit("gravity_lost", "warning", text)

    def _cycle(self, now: int) -> None:
        self._observe(now)
        self._follow_gravity(now)
        self._controller.tick(now)
        self._write_order()
        self._supervise(now)
        if self._presence is not None:
            self._controller.others_seen(self._presence.others)
        if self._questions is not None:
            self._questions.ask(self._controller.question)
        if self._server is not None:
            self._server.stand_in_for_ik(self._shared.ik[0] == 0)
            for tail in filter(self._server.has_subscriber, self._publisher.due(now)):
                self._server.publish(tail, self._publisher.states[tail]())
        self._flush()
        self._save(now)

    def _write_order(self) -> None:
        self._shared.write_order(self._controller.order_at(time.monotonic_ns()))
        if (load := LoadRecord(self._controller.payload, *self._controller.load_at)) != self._load:
            self._load = load
            self._shared.write_load(load)
        if (obstacles := self._controller.obstacles) is not self._obstacles:
            self._obstacles = obstacles
            self._shared.write_scene(packed(obstacles.entries))

    def _observe(self, now: int) -> None:
        estops = self._shared.router[1]
        if estops != self._estops_seen:
            self._estops_seen = estops
            self._controller.estop(now, self._shared.estop_reason)
        report = self._shared.read_report()
        if report is not None:
            self._controller.observe(report, now)
            self._share_knowledge()
            if report.tick != self._tick_seen:
                self._tick_seen, self._ticked_at = report.tick, now

    def _share_knowledge(self) -> None:
        if (knowledge := self._controller.motion_record.knowledge) != self._knowledge:
            self._knowledge = knowledge
            self._shared.write_knowledge(knowledge)

    def _supervise(self, now: int) -> None:
        silent = now - max(self._ticked_at, self._ramp.started_at)
        began = self._ticked_at > self._ramp.started_at
        stuck = silent > (RAMP_TIMEOUT if began else START_TIMEOUT)
        self._keep_alive(self._ramp, began, f"no tick for {silent / SECOND:.1f} s" if stuck else None, "error", now)
        if now >= self._ik_due and self._keep_ik_alive(now):
            self._shared.ik[0] = 0
        heartbeat = self._shared.router[0]
        if self._keep_alive(self._router, heartbeat > 0, silence(heartbeat, ROUTER_TIMEOUT, now), "error", now):
            self._shared.router[0] = 0

    def _keep_ik_alive(self, now: int) -> bool:
        """Whether the ik process was restarted, or given up for a while: the arm does not depend on it."""
        heartbeat = self._shared.ik[0]
        try:
            return self._keep_alive(self._ik, heartbeat > 0, silence(heartbeat, IK_TIMEOUT, now), "warning", now)
        except RestartLimitExceeded as error:
            if not self._was_ready:
                raise
            self._ik_due = now + IK_PAUSE
            text = f"{error}; no kinematics until it starts, which is tried every {IK_PAUSE // SECOND} s"
            self._emit("ik_given_up", "error", text)
            return True

    def _keep_alive(self, child: ChildProcess, began: bool, stuck: str | None, level: Level, now: int) -> bool:
        ended = child.ended() or stuck
        if ended is None:
            return False
        child.kill()
        self._emit(f"{child.name}_died", level, f"the {child.name} process ended ({ended}); restarting it")
        child.restart(now, began)
        return True

    def _answered(self, number: int, reply: Header | LrmError) -> None:
        """Takes the answer to a question of the skill under way."""
        with self._lock:
            self._controller.answer(number, reply, time.monotonic_ns())

    def _save(self, now: int, at_once: bool = False) -> None:
        c = self._controller
        skill, levels = c.skill_report.outcome, map(c.thermal.model.level, c.thermal.temperature)
        load = (c.payload, *c.load_at)
        state = (c.mode, c.position, c.report.moving, c.report.outputs, c.fallen.bits, *load, skill, *levels)
        if self._saving.due(state, c.report.moving, now) or at_once:
            c.stored = c.saved(time.time_ns())
            self._writer.put(c.stored)

    def _on_write(self, error: FileError | None) -> None:
        with self._lock:
            if error is None:
                self._emit("state_saved", "info", "the state can be saved again")
            else:
                self._emit("state_not_saved", "error", f"{error}; after a crash the pose will be an older one")

    # ---- requests, from zenoh's threads (see `zenoh_server.RequestHandler`)

    def handle(self, tail: str, request: Message, came: int) -> Message:
        """Carries out a request that `came` at a time (monotonic ns). Raises `LrmError` if it cannot."""
        if isinstance(request, ReloadRequest | DeployRequest | UndeployRequest):
            deployed = self._changed_model(request)
            self._model.wait_for_ik(deployed)
            with self._lock:
                return self._publisher.reloaded(tail, deployed)
        left = isinstance(request, MotionRequest | PayloadRequest) and self._leave_stored_pose(request)
        if isinstance(request, MoveRequest | JogRequest | ArmRequest):
            self._shared.wait_for_order(self._controller.order.number, SETTLING_TIME)
        with self._lock:
            now = time.monotonic_ns()
            self._observe(now)
            if left:
                self._saving.again()
            # a renewal counts from when it came, not from when the daemon had time for it
            result = self._controller.handle(request, came if isinstance(request, LeaseRequest) else now, came)
            self._write_order()
            self._flush()
            reply, order = self._publisher.reply(tail, result), self._controller.order.number
        if isinstance(request, HoldRequest) and not self._shared.wait_for_order(order, SETTLING_TIME):
            text = "the ramp did not confirm the hold in time; it reads the order as soon as it ticks"
            raise RequestError("hold_unconfirmed", text, retryable=True)
        return self._with_settling(tail, reply, result.final_leg)

    def _leave_stored_pose(self, request: Message) -> bool:
        """Takes the stored pose back before it may become untrue; whether there was one. Raises `RequestError`.

        Without the lock while the disk is slow; so the sender is checked before, lest others outdate the pose.
        """
        with self._lock:
            self._controller.check_sender(request, time.monotonic_ns())
        try:
            return self._writer.leave_pose()
        except FileError as error:
            text = f"{error}: its pose would be taken for the arm's after a fall; make the folder writable"
            raise RequestError("state_not_saved", text) from None

    def _with_settling(self, tail: str, reply: Reply, final_leg: FinalLeg | None) -> Reply:
        """The reply, and how long the tip swings after the motion that it is of, where that is known.

        That takes about a tenth of a second, without the lock.
        """
        if tail != "rpc/move" or final_leg is None or (motion_model := self._controller.motion) is None:
            return reply
        within = self._config.motion.within_mm * 1e-3
        usual, sure = motion_model.settling(final_leg)
        return reply.model_copy(update={"settle_s": usual, "settle_95_s": sure, "within_m": within})

    def _changed_model(self, request: ReloadRequest | DeployRequest | UndeployRequest) -> DeployedModel:
        match request:
            case DeployRequest(kind="motion"):
                return self._adopt_motion(partial(self._motion.deploy, request.text))
            case UndeployRequest(kind="motion"):
                return self._adopt_motion(self._motion.undo)
            case DeployRequest():
                return self._adopt(partial(self._model.deploy, request.text, request.accept))
            case UndeployRequest():
                return self._adopt(self._model.undo)
        return self._adopt(self._model.load)

    def report_refusal(self, tail: str, error: LrmError) -> None:
        """Emits an event for a refused command, which has no reply."""
        reply = error_reply(error, self.boot_id)
        with self._lock:
            self._emit("refused", "warning", f"{tail}: {reply.msg}", why=reply.code)
            self._flush()

    def state(self, tail: str) -> Message:
        """The present state message of a key."""
        with self._lock:
            self._observe(time.monotonic_ns())
            return self._publisher.states[tail]()

    def events(self) -> list[bytes]:
        """The last events, oldest first."""
        with self._lock:
            return self._events.all()

    def _emit(self, code: str, level: Level, text: str, **detail: Any) -> None:
        self._pending.append(ControllerEvent(code, level, text, detail))

    def _flush(self) -> None:
        """Logs, keeps and publishes the pending events."""
        self._pending.extend(self._controller.events)
        self._controller.events.clear()
        if self._server is None:
            return
        now = time.monotonic_ns()
        while self._pending:
            event = self._pending.popleft()
            if self._throttle.passes(event, now):
                self._publish(event, self._server)
        for event in self._throttle.due(now):
            self._publish(event, self._server)

    def _publish(self, event: ControllerEvent, server: ZenohServer) -> None:
        getattr(self._log, event.level)(event.code, text=event.text, detail=event.detail)
        data = pack(self._publisher.event(event))
        self._events.add(event.code, data)
        server.publish_event(event.code, data)
