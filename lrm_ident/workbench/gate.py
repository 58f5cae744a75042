"""Who may talk to the workbench: only this machine's browser that has the token, from the page itself.

Every request and every web socket must name this address as its host (against DNS rebinding), come from no foreign
origin, and carry the token, in the address or in the cookie that the first right address sets.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass

from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

FOREIGN = "This page does not take requests from other pages. Open the address that the terminal shows."
NO_TOKEN = "The token in the address is wrong or missing. Open the whole address that the terminal shows."
REFUSED = """<!doctype html><meta charset="utf-8"><title>lrm-ident workbench</title>
<body style="font:18px system-ui;margin:3em"><h1>Not this way</h1><p>{why}</p>"""


@dataclass(frozen=True)
class Gate:
    """ASGI middleware. `port`: of the page; `token`: what its address carries."""

    app: ASGIApp
    port: int
    token: str

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Lets a request through, or refuses it with the reason."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
        elif why := self._refusal(HTTPConnection(scope)):
            await HTMLResponse(REFUSED.format(why=why), 403)(scope, receive, send)
        else:
            await self.app(scope, receive, self._with_headers(send))

    def _refusal(self, asked: HTTPConnection) -> str:
        hosts = f"127.0.0.1:{self.port}", f"localhost:{self.port}"
        if asked.headers.get("host") not in hosts:
            return FOREIGN
        if asked.headers.get("origin", f"http://{hosts[0]}") not in [f"http://{host}" for host in hosts]:
            return FOREIGN
        given = [*asked.query_params.getlist("token"), asked.cookies.get(self._name, "")]
        return "" if any(secrets.compare_digest(token.encode(), self.token.encode()) for token in given) else NO_TOKEN

    @property
    def _name(self) -> str:
        return f"lrm-workbench-{self.port}"

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

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *added]
            await send(message)

        return sending
