"""Setup of the router process: its configuration, keys and replies, of the messages' kinds."""

from __future__ import annotations

from lrmd.api.router_process import EstopReplies, RouterSetup
from lrmd.config import Config
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.codec import HeaderSource, error_reply
from lrmd.messages.control import Reply
from lrmd.messages.rate_limits import with_rate_limits
from lrmd.messages.zenoh_session import GONE_KEY, key, router, wildcard_error
from lrmd.ramp.shared_fd import SharedFd


def estop_replies(query: str, boot_id: str) -> EstopReplies:
    """The replies to the emergency stop on the key `query`."""
    silent = "the ramp did not confirm the stop in time; it reads the signal as soon as it ticks"
    stopped = Reply(**HeaderSource(boot_id).next(query), mode=Mode.ESTOP.value)
    errors = RequestError("estop_unconfirmed", silent, retryable=True), wildcard_error(query)
    return EstopReplies(stopped.model_dump(), *(error_reply(error, boot_id).model_dump() for error in errors))


def router_setup(config: Config, memory: SharedFd, estop: SharedFd, boot_id: str) -> RouterSetup:
    """Start arguments of the router process. Raises `FileError` for a zenoh configuration that cannot be read."""
    query = key(config.robot, "rpc/estop")
    keys = key(config.robot, "cmd/estop"), key("*", "cmd/estop")
    zenoh = str(with_rate_limits(router(config.zenoh)))
    return RouterSetup(zenoh, keys, query, GONE_KEY, estop_replies(query, boot_id), memory, estop)
