"""Who the viewer serves: no page without the token, no page of somebody else."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

pytest.importorskip("starlette")

from mitsuba_restir.viewer.security import Guard, Policy, is_loopback, judge, policy_of

HERE = Policy("127.0.0.1", 7780, None)
OUT = Policy("0.0.0.0", 7780, "secret")
COOKIE = f"{OUT.cookie}=secret"


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "[::1]", "127.9.9.9"])
def test_this_machine_needs_no_token(host):
    assert policy_of(host, 1).token is None


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "example.org", ""])
def test_every_other_address_has_one_of_its_own(host):
    first, second = policy_of(host, 1).token, policy_of(host, 1).token
    assert first
    assert first != second
    assert not is_loopback(host)


@pytest.mark.parametrize(
    ("policy", "headers", "query", "allowed"),
    [
        (HERE, {"host": "127.0.0.1:7780"}, "", True),
        (HERE, {"host": "localhost:7780", "origin": "http://localhost:7780"}, "", True),
        (HERE, {"host": "[::1]:7780"}, "", True),
        (HERE, {"host": "127.0.0.1:7780", "origin": "http://evil.example"}, "", False),
        (HERE, {"host": "127.0.0.1:7780", "origin": "http://127.0.0.1:9999"}, "", False),
        (HERE, {"host": "127.0.0.1:7780", "origin": "null"}, "", False),
        (HERE, {"host": "evil.example:7780", "origin": "http://evil.example:7780"}, "", False),
        (HERE, {}, "", False),
        (OUT, {"host": "box:7780"}, "", False),
        (OUT, {"host": "box:7780"}, "token=wrong", False),
        (OUT, {"host": "box:7780"}, "token=", False),
        (OUT, {"host": "box:7780"}, "token=secret", True),
        (OUT, {"host": "box:7780", "cookie": COOKIE}, "", True),
        (OUT, {"host": "box:7780", "cookie": COOKIE + "x"}, "", False),
        (OUT, {"host": "box:7780", "cookie": "\x00;;=,"}, "", False),
        (OUT, {"host": "box:7780", "cookie": COOKIE, "origin": "http://box:7780"}, "", True),
        (OUT, {"host": "box:7780", "cookie": COOKIE, "origin": "http://evil"}, "", False),
        (OUT, {"host": "box:7780", "origin": "http://evil"}, "token=secret", False),
    ],
)
def test_verdicts(policy, headers, query, allowed):
    verdict = judge(policy, headers, query)
    assert verdict.allowed is allowed
    assert allowed or verdict.why


def _answer(policy: Policy, kind: str, query: str = "", **headers: str) -> list[dict[str, Any]]:
    """What is sent for a request; the application behind the guard says ``served``."""
    sent: list[dict[str, Any]] = []

    async def application(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "served"})

    async def receive() -> dict[str, Any]:
        return {"type": f"{kind}.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {
        "type": kind,
        "path": "//evil.example/page",
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    asyncio.run(Guard(application, policy)(scope, receive, send))
    return sent


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_pages_and_websockets_are_refused_alike(kind):
    for policy, headers in (
        (OUT, {"host": "box:7780"}),
        (HERE, {"host": "127.0.0.1:7780", "origin": "http://evil.example"}),
    ):
        (first, *_) = _answer(policy, kind, **headers)
        assert first["type"] != "served"
        assert first.get("status", 403) == 403
    assert _answer(HERE, kind, host="127.0.0.1:7780") == [{"type": "served"}]


def test_the_token_goes_from_the_address_into_a_cookie():
    start, _ = _answer(OUT, "http", "token=secret&x=1", host="box:7780")
    headers = {name.decode(): value.decode() for name, value in start["headers"]}
    assert start["status"] == 303
    # To the viewer's own pages only, whatever the path.
    assert headers["location"] == "/evil.example/page?x=1"
    assert "secret" in headers["set-cookie"]
    assert "HttpOnly" in headers["set-cookie"]
