"""The zenoh server of the api process: its keys, and the calls and replies of the messages that arrive on them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import structlog
import zenoh
from zenoh.handlers import Callback

from lrm_math.errors import LrmError
from lrmd.errors import RequestError
from lrmd.messages import control, skills
from lrmd.messages.codec import Message, pack
from lrmd.messages.control import MODELS
from lrmd.messages.inbox import PLACES, Inbox
from lrmd.messages.kinematics import CANCEL
from lrmd.messages.kinematics import REQUESTS as KINEMATICS
from lrmd.messages.zenoh_session import addresses, key, reply_error, serve, subscribe

REQUESTS: dict[str, type[Message]] = {**control.REQUESTS, **skills.REQUESTS}
COMMANDS: dict[str, type[Message]] = {**control.COMMANDS, **skills.COMMANDS}


class RequestHandler(Protocol):
    """Handler of the messages that arrive; called from zenoh's threads. `boot_id`: of this start of the daemon."""

    boot_id: str

    def handle(self, tail: str, request: Message, came: int) -> Message:
        """Carries a request out that `came` at a time (monotonic ns): the reply. Raises what `error_reply` takes."""

    def report_refusal(self, tail: str, error: LrmError) -> None:
        """Reports a refused command, which has no reply, as an event."""

    def state(self, tail: str) -> Message:
        """The present state of a key."""

    def events(self) -> list[bytes]:
        """The events that are kept, packed, oldest first."""


class ZenohServer:
    """Publishers, queryables and subscribers of one robot on a session; `states`: keys of its state messages."""

    def __init__(
        self, session: zenoh.Session, robot: str, handler: RequestHandler, states: tuple[str, ...],
        inbox: Callable[[int], Inbox] = Inbox,
    ) -> None:  # fmt: skip
        """`inbox`: makes an inbox with so many places."""
        self._session, self._robot, self._handler = session, robot, handler
        self._log = structlog.get_logger().bind(robot=robot)
        drop: dict[str, Any] = {"congestion_control": zenoh.CongestionControl.DROP}
        self._publishers = {t: session.declare_publisher(key(robot, t), express=True, **drop) for t in states}
        for tail in states:
            self._serve(tail, None, partial(self._state, tail), inbox(PLACES), wildcards=True)
        models = inbox(1)
        for tail, kind in REQUESTS.items():
            inbox_of_key = models if tail in MODELS else inbox(PLACES)
            self._serve(tail, kind, partial(self._request, tail, inbox_of_key), inbox_of_key)
        self._serve("rpc/events", None, lambda _: handler.events(), inbox(PLACES))
        for tail, kind in COMMANDS.items():
            inbox_of_key = inbox(PLACES)
            take, fail = partial(self._command, tail, inbox_of_key), partial(self._command_failed, tail)
            subscribe(session, key(robot, tail), kind, take, fail, inbox_of_key)
        self._stand_ins: list[zenoh.Queryable[None]] = []
        self._alive = session.liveliness().declare_token(key(robot, "alive/lrmd"))

    def has_subscriber(self, tail: str) -> bool:
        """Whether anybody reads the publications of a state."""
        status = self._publishers[tail].matching_status  # an object, whatever zenoh's stub says
        return bool(getattr(status, "matching", status))

    def stand_in_for_ik(self, away: bool) -> None:
        """Refuses the queries of the ik process while it is away: without a queryable they would get no reply."""
        if away and not self._stand_ins:
            keys = (key(self._robot, tail) for tail in (*KINEMATICS, CANCEL))
            refuse: Callback[zenoh.Query] = Callback(self._refuse, indirect=False)
            self._stand_ins = [self._session.declare_queryable(whole, refuse) for whole in keys]
        while self._stand_ins and not away:
            self._stand_ins.pop().undeclare()  # type: ignore[no-untyped-call]

    def _refuse(self, query: zenoh.Query) -> None:
        error = RequestError("busy", "the ik process is being started; ask again", retryable=True)
        reply_error(query, error, self._log, self._handler.boot_id)

    def publish(self, tail: str, message: Message) -> None:
        """Publishes a state; a slow subscriber loses messages."""
        self._publishers[tail].put(pack(message))

    def publish_event(self, code: str, data: bytes) -> None:
        """Publishes a packed event."""
        self._session.put(
            key(self._robot, f"event/{code}"), data, congestion_control=zenoh.CongestionControl.DROP, express=True
        )

    def _serve(
        self, tail: str, kind: type[Message] | None, answer: Callable[[Any], list[bytes]], inbox: Inbox,
        wildcards: bool = False,
    ) -> None:  # fmt: skip
        fail = partial(reply_error, log=self._log, boot_id=self._handler.boot_id)
        serve(self._session, key(self._robot, tail), kind, lambda _, request: answer(request), fail, inbox, wildcards)

    def _state(self, tail: str, _: Message) -> list[bytes]:
        return [pack(self._handler.state(tail))]

    def _request(self, tail: str, inbox: Inbox, request: Message) -> list[bytes]:
        return [pack(self._handler.handle(tail, request, inbox.came))]

    def _command(self, tail: str, inbox: Inbox, sample: zenoh.Sample, command: Message) -> None:
        if not addresses(sample.key_expr, self._robot, tail):
            raise RequestError("wildcard", f"put on {str(sample.key_expr)[:64]}, which is not a key of commands")
        self._handler.handle(tail, command, inbox.came)

    def _command_failed(self, tail: str, error: Exception) -> None:
        if isinstance(error, LrmError):
            self._handler.report_refusal(tail, error)
        else:
            self._log.error("internal_error", key=tail, exc_info=error)
