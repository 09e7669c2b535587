"""Who is let in: only the page that this server gave out, on this machine, with its token.

Every request passes here, WebSockets and the page's own files too. The name it was sent to must be the server's (so that no
other site's name can be pointed at this machine), an Origin, where a browser gives one, must be the page's own, and one of
two secrets must be shown: the token that the address printed at the start carries, in the query of `/` or as
`Authorization: Bearer`; or the cookie that the page is given for it, which is another secret and counts only with a
browser's word that the request comes from the page itself (Origin, or Sec-Fetch-Site). The browser that the program opens
gets that cookie at a door instead (`door`), whose code, in the query of `/`, is no secret.

Limit: browsers send a cookie to every port of this machine. A server of somebody else here that the user visits sees it, and
a program, unlike a page, can write the browser's word itself. Who lets others run servers on the machine closes the page's
tab before visiting them; the token they do not see.
"""

from __future__ import annotations

import hmac
import logging
import secrets
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from synth.author.door import Door

LOG = logging.getLogger(__name__)
POLICY = (
    "default-src 'self'; connect-src 'self' {sockets}; img-src 'self' data: blob:; media-src 'self' blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
PRINTED = "use the address that `synth author` printed"
#: what a browser says of where a request comes from, unless it is another site; `none`: typed, or opened by a program
OWN_SITE = ("same-origin", "none")


class Guard:
    """ASGI middleware around `app` for a server on `port` whose pages show `token`, or come by a door."""

    def __init__(self, app: Any, port: int, token: str) -> None:
        self._app = app
        self._door: Door | None = None
        self._token = token.encode()
        self._page = secrets.token_urlsafe(32).encode()
        self._hosts = (f"127.0.0.1:{port}", f"localhost:{port}")
        self.cookie = f"jawari-{port}"
        policy = POLICY.format(sockets=" ".join(f"ws://{host}" for host in self._hosts))
        self._headers = [
            (b"content-security-policy", policy.encode()),
            (b"cache-control", b"no-store"),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-resource-policy", b"same-origin"),
            (b"cross-origin-opener-policy", b"same-origin"),
        ]

    def door(self) -> Door:
        """A new door, instead of one that was there."""
        self._door = Door()
        return self._door

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal, by_query = self._judge(scope)
        if refusal is not None:
            await self._refuse(scope, refusal, send)
            return

        async def send_guarded(message: Any) -> None:
            if message["type"] == "http.response.start":
                headers = [*message.get("headers", []), *self._headers]
                if by_query:
                    cookie = f"{self.cookie}={self._page.decode()}; HttpOnly; SameSite=Strict; Path=/"
                    headers.append((b"set-cookie", cookie.encode()))
                message = {**message, "headers": headers}
            await send(message)

        await self._app(scope, receive, send_guarded)

    def _judge(self, scope: Any) -> tuple[str | None, bool]:
        """(why it is refused or None, whether the token stands in the query)."""
        headers: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
        hosts = headers.get("host", [])
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return f"this server answers to {' and '.join(self._hosts)} only", False
        if any(origin.lower() != f"http://{hosts[0].lower()}" for origin in headers.get("origin", [])):
            return "requests from other pages are refused", False
        at_door = scope["type"] == "http" and scope["path"] == "/" and scope["method"] in ("GET", "HEAD")
        query = parse_qs(scope["query_string"].decode("latin-1")) if at_door else {}
        if asked := query.get("token", []):
            if _same(asked[-1], self._token):
                return None, True
            return f"wrong token: {PRINTED}", False
        refusal = self._by_cookie(headers)
        if refusal is not None and (code := query.get("door", [])) and scope["method"] == "GET":
            # a page that was let in by it is loaded again by its cookie
            why = self._at_door(code[-1], scope)
            return (None, True) if why is None else (f"{why}: {PRINTED}", False)
        return refusal, False

    def _at_door(self, code: str, scope: Any) -> str | None:
        if self._door is None:
            return "wrong door"
        why = self._door.opens(code, scope.get("client"), scope.get("server"))
        if why is not None and self._door.used and self._door.unsure and self._door.knows(code):
            self._page = secrets.token_urlsafe(32).encode()
            self._door = None
            LOG.warning("the page was opened twice, perhaps by another user: only the address above gives access now")
        return why

    def _by_cookie(self, headers: dict[str, list[str]]) -> str | None:
        """Why a request is refused by what its headers show, or None."""
        sites = headers.get("sec-fetch-site", [])
        if any(site not in OWN_SITE for site in sites):
            return "requests from other pages are refused"
        tokens = [value[7:] for value in headers.get("authorization", []) if value[:7].lower() == "bearer "]
        cookies = []
        for line in headers.get("cookie", []):
            try:
                morsel = SimpleCookie(line).get(self.cookie)
            except CookieError:
                continue
            if morsel is not None:
                cookies.append(morsel.value)
        if not tokens and not cookies:
            return f"no token: {PRINTED}"
        if any(_same(each, self._token) for each in tokens):
            return None
        if not any(_same(each, self._page) for each in cookies):
            return f"wrong token: {PRINTED}"
        if not sites and not headers.get("origin"):  # both are checked above
            return "the cookie is valid only in a request whose browser says where it comes from"
        return None

    async def _refuse(self, scope: Any, reason: str, send: Any) -> None:
        body = f"403: {reason}\n".encode()
        start = {
            "status": 403,
            "headers": [
                (b"content-type", b"text/plain; charset=utf-8"),
                (b"content-length", b"%d" % len(body)),
                *self._headers,
            ],
        }
        if scope["type"] == "http":
            await send({"type": "http.response.start", **start})
            await send({"type": "http.response.body", "body": body})
        elif "websocket.http.response" in scope.get("extensions", {}):
            await send({"type": "websocket.http.response.start", **start})
            await send({"type": "websocket.http.response.body", "body": body})
        else:
            await send({"type": "websocket.close", "code": 1008, "reason": reason})


def _same(text: str, secret: bytes) -> bool:
    return hmac.compare_digest(text.encode("utf-8", "surrogateescape"), secret)
