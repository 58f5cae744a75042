"""The daemon's face on zenoh: which keys it has, and how what arrives there becomes a call, and an error a reply."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import structlog
import zenoh

from lrm_math.errors import LrmError, UnknownName
from lrmd.control.lease import LeaseError
from lrmd.control.state_machine import NotAllowed
from lrmd.errors import Refused
from lrmd.messages.control import (
    ArmRequest,
    DisarmRequest,
    ErrorReply,
    HoldRequest,
    JogRequest,
    LeaseRequest,
    Message,
    MessageError,
    MoveRequest,
    RelaxRequest,
    ReloadRequest,
    ResetRequest,
    pack,
    unpack,
)
from lrmd.messages.zenoh_session import key

REQUESTS: dict[str, type[Message]] = {
    "rpc/lease": LeaseRequest,
    "rpc/arm": ArmRequest,
    "rpc/move": MoveRequest,
    "rpc/hold": HoldRequest,
    "rpc/relax": RelaxRequest,
    "rpc/disarm": DisarmRequest,
    "rpc/reset_fault": ResetRequest,
    "rpc/reload": ReloadRequest,
}
COMMANDS: dict[str, type[Message]] = {"cmd/target": MoveRequest, "cmd/jog": JogRequest}


class Owner(Protocol):
    """Who carries out what arrives. Called from zenoh's threads."""

    def carry_out(self, tail: str, request: Message) -> Message: ...
    def refused(self, tail: str, error: LrmError) -> None: ...
    def stop_everything(self, data: bytes) -> Message: ...
    def state(self, tail: str) -> Message: ...
    def events(self) -> list[bytes]: ...


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
        case UnknownName():
            return ErrorReply(code="unknown_servo", msg=str(error), detail={"valid": list(error.valid)})
        case _:
            return ErrorReply(code="error", msg=str(error))


class Face:
    """Everything that is declared on a session, for one robot."""

    def __init__(self, session: zenoh.Session, robot: str, owner: Owner, states: tuple[str, ...]) -> None:
        self._session, self._robot, self._owner = session, robot, owner
        self._log = structlog.get_logger().bind(robot=robot)
        drop: dict[str, Any] = {"congestion_control": zenoh.CongestionControl.DROP}
        self._publishers = {t: session.declare_publisher(key(robot, t), express=True, **drop) for t in states}
        for tail in states:
            self._queryable(tail, partial(self._state, tail))
        for tail in REQUESTS:
            self._queryable(tail, partial(self._request, tail))
        self._queryable("rpc/estop", lambda data: [pack(owner.stop_everything(data))])
        self._queryable("rpc/events", lambda _: owner.events())
        for tail in COMMANDS:
            session.declare_subscriber(key(robot, tail), self._commanded(tail))
        session.declare_subscriber(key(robot, "cmd/estop"), lambda s: self._stop(s.payload.to_bytes()))
        self._alive = session.liveliness().declare_token(key(robot, "alive/lrmd"))

    def publish(self, tail: str, message: Message) -> None:
        """Sends a state to whoever listens; a listener that does not read loses it."""
        self._publishers[tail].put(pack(message))

    def tell(self, code: str, data: bytes) -> None:
        """Sends an event."""
        self._session.put(
            key(self._robot, f"event/{code}"), data, congestion_control=zenoh.CongestionControl.DROP, express=True
        )

    def _request(self, tail: str, data: bytes) -> list[bytes]:
        return [pack(self._owner.carry_out(tail, unpack(REQUESTS[tail], data)))]

    def _state(self, tail: str, _: bytes) -> list[bytes]:
        return [pack(self._owner.state(tail))]

    def _queryable(self, tail: str, answer: Callable[[bytes], list[bytes]]) -> None:
        """A queryable that always answers: an exception in zenoh's callback would look like nobody being there."""
        own = key(self._robot, tail)

        def reply(query: zenoh.Query) -> None:
            with query:
                if str(query.key_expr) != own and not tail.startswith(("state/", "info")):
                    text = f"ask {own} itself; requests to several at once are not carried out"
                    query.reply_err(pack(ErrorReply(code="wildcard", msg=text)))
                    return
                try:
                    for data in answer(query.payload.to_bytes() if query.payload else b""):
                        query.reply(own, data)
                except LrmError as error:
                    query.reply_err(pack(error_reply(error)))
                except Exception as error:
                    self._log.exception("internal_error", key=own)
                    query.reply_err(pack(ErrorReply(code="internal", msg=f"{type(error).__name__}: {error}")))

        self._session.declare_queryable(own, reply)

    def _commanded(self, tail: str) -> Callable[[zenoh.Sample], None]:
        def obey(sample: zenoh.Sample) -> None:
            try:
                self._owner.carry_out(tail, unpack(COMMANDS[tail], sample.payload.to_bytes()))
            except LrmError as error:
                self._owner.refused(tail, error)
            except Exception:
                self._log.exception("internal_error", key=tail)

        return obey

    def _stop(self, data: bytes) -> None:
        try:
            self._owner.stop_everything(data)
        except Exception:
            self._log.exception("internal_error", key="cmd/estop")
