"""Who may talk to the workbench: only this machine's browser that has the token, from the page itself.

Every request and every web socket must name this address as its host (against DNS rebinding), come from no foreign
origin, and carry the token, in the address or in the cookie that the first right address sets.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

FOREIGN = "This page does not take requests from other pages. Open the address that the terminal shows."
NO_TOKEN = "The token in the address is wrong or missing. Open the whole address that the terminal shows."
REFUSED = """<!doctype html><meta charset="utf-8"><title>lrm-ident workbench</title>
<body style="font:18px system-ui;margin:3em"><h1>Not this way</h1><p>{why}</p>"""


@dataclass(frozen=True)
class Gate:
    """ASGI middleware. `port`: of the page; `token`: what its address carries."""

    app: App
    port: int
    token: str

    @property
    def hosts(self) -> tuple[str, ...]:
        """Values that the header Host may have."""
        return f"127.0.0.1:{self.port}", f"localhost:{self.port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Lets a request through, or refuses it with the reason."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        why = self._refusal(headers, scope)
        if why:
            await _refuse(scope, receive, send, why)
            return
        await self.app(scope, receive, self._with_headers(send))

    def _refusal(self, headers: dict[str, str], scope: Scope) -> str:
        origin = headers.get("origin")
        if headers.get("host") not in self.hosts:
            return FOREIGN
        if origin is not None and origin not in [f"http://{host}" for host in self.hosts]:
            return FOREIGN
        given = [*parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", []), self._cookie(headers)]
        return "" if any(secrets.compare_digest(one.encode(), self.token.encode()) for one in given) else NO_TOKEN

    @property
    def _name(self) -> str:
        return f"lrm-workbench-{self.port}"

    def _cookie(self, headers: dict[str, str]) -> str:
        try:
            found = SimpleCookie(headers.get("cookie", "")).get(self._name)
        except CookieError:
            return ""
        return found.value if found else ""

    def _with_headers(self, send: Send) -> Send:
        """Answers set the cookie; they tell the browser to load nothing from elsewhere and to pass on no address."""
        policy = (
            "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
            f"img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' ws://127.0.0.1:{self.port} "
            f"ws://localhost:{self.port}; worker-src 'self' blob:; frame-ancestors 'none'"
        )
        added = [
            (b"set-cookie", f"{self._name}={self.token}; Path=/; HttpOnly; SameSite=Strict".encode()),
            (b"content-security-policy", policy.encode()),
            (b"referrer-policy", b"no-referrer"),
        ]

        async def sending(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *added]
            await send(message)

        return sending


async def _refuse(scope: Scope, receive: Receive, send: Send, why: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": why})
        return
    headers = [(b"content-type", b"text/html; charset=utf-8")]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": REFUSED.format(why=why).encode()})
