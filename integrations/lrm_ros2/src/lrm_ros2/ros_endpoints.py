"""Ends of ROS 2's graph as `rmw_zenoh` maps them, that zenoh tells in the order in which messages come (`Arrivals`).

A service is a queryable: CDR in and out, with an attachment that says whose request it is. It answers whenever the
answer is known, from any thread.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any, Protocol

from lrm_ros2.arrivals import Arrivals
from lrm_ros2.message_types import as_message, type_hash, type_store


class ServiceAnswer(Protocol):
    """Answers a request with the fields of the response; later calls are of no effect."""

    def __call__(self, **fields: Any) -> None: ...


Handler = Callable[[Any, ServiceAnswer, int], object]
"""Gets a request, its answer and its number; must not wait."""


class RosEndpoint:
    """One end of the graph: its key, and the liveliness tokens by which others find it.

    `kind`: of the SDK's `EntityKind`; `network`: a `RosNetwork`; `session`: of the SDK.
    """

    def __init__(self, sdk: Any, session: Any, network: Any, kind: Any, name: str, type_: str, node: str) -> None:
        package, of, plain = type_.split("/")
        dds, hash_ = f"{package}::{of}::dds_::{plain}_", type_hash(type_, network.distribution)
        place = sdk.entity.NodeEntity(network.domain, session.session_id, session.get_next_node_id(), node)
        end = sdk.entity.EndpointEntity(
            place, session.get_next_entity_id(), kind, name, dds, hash_, sdk.qos.DEFAULT_QOS_PROFILE.encode()
        )
        self.key = sdk.keyexpr.topic_keyexpr(network.domain, name, dds, hash_)
        self._tokens = [
            session.liveliness.declare_token(key)
            for key in (sdk.keyexpr.node_liveliness_keyexpr(place), sdk.keyexpr.endpoint_liveliness_keyexpr(end))
        ]

    def close(self) -> None:
        """Takes it from the network."""
        for token in self._tokens:
            token.undeclare()


class RosListener(RosEndpoint):
    """A topic that is listened to: `take` gets each message and its number."""

    def __init__(
        self, sdk: Any, session: Any, network: Any, name: str, type_: str, node: str, arrivals: Arrivals,
        take: Callable[[Any, int], object],
    ) -> None:  # fmt: skip
        super().__init__(sdk, session, network, sdk.entity.EntityKind.SUBSCRIPTION, name, type_, node)
        self._store, self._name, self._take = type_store(network.distribution), as_message(type_), take
        self._subscriber = session.session.declare_subscriber(self.key, arrivals.taken_by(self._heard))

    def close(self) -> None:
        """See `RosEndpoint`."""
        super().close()
        self._subscriber.undeclare()

    def _heard(self, sample: Any, number: int) -> None:
        try:
            message = self._store.deserialize_cdr(sample.payload.to_bytes(), self._name)
        except Exception:  # whatever the bytes were
            print(f"{self.key}: a message that cannot be read", file=sys.stderr)
            return
        self._take(message, number)


class RosService(RosEndpoint):
    """A service that is open. `stops`: whatever is asked of it is a stop."""

    def __init__(
        self, sdk: Any, session: Any, network: Any, name: str, service: str, node: str, arrivals: Arrivals,
        handler: Handler, stops: bool,
    ) -> None:  # fmt: skip
        super().__init__(sdk, session, network, sdk.entity.EntityKind.SERVICE, name, service, node)
        self._service, self._handler = service, handler
        self._store, self._attachment = type_store(network.distribution), sdk.attachment.Attachment
        asked = arrivals.taken_by(self._asked, stops)
        self._queryable = session.session.declare_queryable(self.key, asked, complete=True)

    def close(self) -> None:
        """See `RosEndpoint`."""
        super().close()
        self._queryable.undeclare()

    def _asked(self, query: Any, number: int) -> None:
        try:
            whose = self._attachment.from_bytes(query.attachment.to_bytes())
            request = self._store.deserialize_cdr(query.payload.to_bytes(), f"{self._service}_Request")
        except Exception:  # whatever the bytes were
            with query:
                query.reply_err(b"no request of this service, or one without an attachment")
            return

        def answer(**fields: Any) -> None:
            """See `ServiceAnswer`."""
            name = f"{self._service}_Response"
            data = bytes(self._store.serialize_cdr(self._store.types[name](**fields), name))
            said = self._attachment(whose.sequence_id, time.time_ns(), whose.gid).to_bytes()
            query.reply(self.key, data, encoding="application/cdr", attachment=said)
            query.drop()

        self._handler(request, answer, number)
