"""A service of ROS 2 as `rmw_zenoh` maps it: a queryable, CDR in and out, an attachment that says whose request it is.

It answers whenever the answer is known, from any thread, so that nobody waits on a thread of zenoh.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

from lrm_ros2.message_types import type_hash, type_store


class ServiceAnswer(Protocol):
    """Answers a request with the fields of the response; later calls are of no effect."""

    def __call__(self, **fields: Any) -> None: ...


Handler = Callable[[Any, ServiceAnswer], object]


class RosService:
    """A service that is open. `handler`: gets each request and its answer, on a thread of zenoh; must not wait.

    `network`: a `RosNetwork`. `session`: of the SDK.
    """

    def __init__(
        self, sdk: Any, session: Any, network: Any, name: str, service: str, node: str, handler: Handler
    ) -> None:
        self._service, self._handler = service, handler
        self._store, self._attachment = type_store(network.distribution), sdk.attachment.Attachment
        package, kind, plain = service.split("/")
        dds, hash_ = f"{package}::{kind}::dds_::{plain}_", type_hash(service, network.distribution)
        place = sdk.entity.NodeEntity(network.domain, session.session_id, session.get_next_node_id(), node)
        kinds = sdk.entity.EntityKind
        end = sdk.entity.EndpointEntity(
            place, session.get_next_entity_id(), kinds.SERVICE, name, dds, hash_,
            sdk.qos.DEFAULT_QOS_PROFILE.encode(),
        )  # fmt: skip
        self.key = sdk.keyexpr.topic_keyexpr(network.domain, name, dds, hash_)
        self._queryable = session.session.declare_queryable(self.key, self._asked, complete=True)
        self._tokens = [
            session.liveliness.declare_token(key)
            for key in (sdk.keyexpr.node_liveliness_keyexpr(place), sdk.keyexpr.endpoint_liveliness_keyexpr(end))
        ]

    def close(self) -> None:
        """Takes it from the network."""
        for token in self._tokens:
            token.undeclare()
        self._queryable.undeclare()

    def _asked(self, query: Any) -> None:
        try:
            whose = self._attachment.from_bytes(query.attachment.to_bytes())
            request = self._store.deserialize_cdr(query.payload.to_bytes(), f"{self._service}_Request")
        except Exception:  # whatever the bytes were
            query.reply_err(b"no request of this service, or one without an attachment")
            return

        def answer(**fields: Any) -> None:
            """See `ServiceAnswer`."""
            name = f"{self._service}_Response"
            data = bytes(self._store.serialize_cdr(self._store.types[name](**fields), name))
            said = self._attachment(whose.sequence_id, time.time_ns(), whose.gid).to_bytes()
            query.reply(self.key, data, encoding="application/cdr", attachment=said)
            query.drop()

        self._handler(request, answer)
