"""Who is served: the machine itself, or whoever has the token; never a page of somebody else.

NiceGUI lets pages of any origin open its websocket, so that all requests, for pages, polling and
websockets, are looked at here first.
"""

from __future__ import annotations

import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlencode

from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

QUERY = "token"


@dataclass(frozen=True)
class Policy:
    """
    Who is served.

    Attributes
    ----------
    host : str
        That the server listens at.
    port : int
    token : str or None
        None where none is needed: on this machine only.
    """

    host: str
    port: int
    token: str | None

    @property
    def cookie(self) -> str:
        """Name of the cookie with the token; ports of one machine share their cookies."""
        return f"mitsuba_restir_{self.port}"


def policy_of(host: str, port: int) -> Policy:
    """The policy of a server: a token of its own for every address but those of this machine."""
    return Policy(host, port, None if is_loopback(host) else secrets.token_urlsafe(24))


def is_loopback(host: str) -> bool:
    """Whether a name or address is this machine's own."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class Verdict:
    """What becomes of a request: ``allowed``, ``why`` not, ``fresh`` if the token is in its URL."""

    allowed: bool
    why: str = ""
    fresh: bool = False


def judge(policy: Policy, headers: Mapping[str, str], query: str) -> Verdict:
    """
    Judge a request.

    Parameters
    ----------
    headers : mapping
        With names in lower case.
    query : str
        Of its URL.
    """
    host = headers.get("host", "")
    if policy.token is None and not is_loopback(_name(host)):
        # A name that an attacker's server gives out for 127.0.0.1.
        return Verdict(False, "this viewer is for this machine only")
    origin = headers.get("origin")
    if origin is not None and origin.partition("://")[2] != host:
        return Verdict(False, "this viewer does not talk to pages of other origins")
    if policy.token is None:
        return Verdict(True)
    given = parse_qs(query).get(QUERY, [""])[0]
    if _equal(given, policy.token):
        return Verdict(True, fresh=True)
    if _equal(_cookie(headers.get("cookie", ""), policy.cookie), policy.token):
        return Verdict(True)
    return Verdict(False, "open the address with the token that the viewer has printed")


class Guard:
    """
    ASGI middleware that serves only what the policy allows.

    Parameters
    ----------
    app : ASGI application
    policy : Policy
    """

    def __init__(self, app: ASGIApp, policy: Policy) -> None:
        self.app = app
        self._policy = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve, or refuse with 403."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): v.decode("latin-1") for name, v in scope["headers"]}
        query = scope["query_string"].decode("latin-1")
        verdict = judge(self._policy, headers, query)
        if not verdict.allowed:
            await self._refuse(scope, receive, send, verdict.why)
        elif verdict.fresh and scope["type"] == "http":
            await self._welcome(scope["path"], query)(scope, receive, send)
        else:
            await self.app(scope, receive, send)

    async def _refuse(self, scope: Scope, receive: Receive, send: Send, why: str) -> None:
        if scope["type"] == "websocket":
            # Before it is accepted: the server answers 403.
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(f"403: {why}\n", 403)(scope, receive, send)

    def _welcome(self, path: str, query: str) -> Response:
        """To the same page without the token, which goes into a cookie: addresses are passed on."""
        rest = {name: values for name, values in parse_qs(query).items() if name != QUERY}
        target = f"/{path.lstrip('/')}" + (f"?{urlencode(rest, doseq=True)}" if rest else "")
        response = RedirectResponse(target, 303, {"Referrer-Policy": "no-referrer"})
        assert self._policy.token is not None
        response.set_cookie(self._policy.cookie, self._policy.token, httponly=True, samesite="lax")
        return response


def _name(host: str) -> str:
    """The name or address in ``name:port``."""
    return host if host.endswith("]") else (host.rpartition(":")[0] or host)


def _cookie(text: str, name: str) -> str:
    try:
        morsel = SimpleCookie(text).get(name)
    except CookieError:
        return ""
    return morsel.value if morsel else ""


def _equal(given: str, token: str) -> bool:
    return secrets.compare_digest(given.encode(), token.encode())
