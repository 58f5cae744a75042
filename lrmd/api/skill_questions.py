"""Questions of the skill under way to the daemon's own ik process, which answers them like those of any client."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import zenoh

from lrm_math.errors import LrmError
from lrmd.errors import RequestError
from lrmd.messages.codec import ErrorReply, Header, unpack
from lrmd.messages.codec import pack as packed
from lrmd.messages.kinematics import (
    FkReply,
    FkRequest,
    IkReply,
    IkRequest,
    KinematicsReply,
    KinematicsRequest,
    PlanReply,
    PlanRequest,
)
from lrmd.messages.zenoh_session import key

KINDS: dict[type[KinematicsRequest], tuple[str, type[KinematicsReply]]] = {
    IkRequest: ("rpc/ik", IkReply),
    FkRequest: ("rpc/fk", FkReply),
    PlanRequest: ("rpc/plan", PlanReply),
}
TIMEOUT_S = 2.0
"""s beyond a question's own deadline."""
Answered = Callable[[int, Header | LrmError], None]
"""Takes the reply to the question of a number, or why there is none; called from zenoh's threads."""


class SkillQuestions:
    """Sends each question once."""

    def __init__(self, session: zenoh.Session, robot: str, boot_id: str, answered: Answered) -> None:
        self._session, self._robot, self._boot_id, self._answered = session, robot, boot_id, answered
        self._name = session.declare_querier(key(robot, "rpc/ik")).id
        self._asked: KinematicsRequest | None = None

    def ask(self, question: tuple[int, KinematicsRequest] | None) -> None:
        """Sends the question that a skill waits for the answer to, unless it was sent."""
        if question is None or question[1] is self._asked:
            return
        number, self._asked = question
        tail, kind = KINDS[type(self._asked)]
        self._session.get(
            key(self._robot, tail), partial(self._on_reply, number, kind), payload=packed(self._asked),
            timeout=TIMEOUT_S + self._asked.deadline_ms / 1000, target=zenoh.QueryTarget.ALL,
            source_info=zenoh.SourceInfo(self._name, 0),
        )  # fmt: skip

    def _on_reply(self, number: int, kind: type[KinematicsReply], reply: zenoh.Reply) -> None:
        """A reply of the own ik process, or an error; replies of others are ignored."""
        try:
            if reply.ok is not None:
                reply_message: KinematicsReply | LrmError = unpack(kind, reply.ok.payload.to_bytes())
                if isinstance(reply_message, KinematicsReply) and reply_message.boot_id != self._boot_id:
                    return
            else:
                reply_message = _refusal(b"" if reply.err is None else reply.err.payload.to_bytes())
        except LrmError as error:
            reply_message = error
        self._answered(number, reply_message)


def _refusal(data: bytes) -> LrmError:
    try:
        refused = unpack(ErrorReply, data)
    except LrmError:
        return RequestError("deadline", "the ik process gave no answer in time", retryable=True)
    return RequestError(refused.code, refused.msg)
