"""Access checks of hosts, origins and the token, and the headers that every answer has."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Collection
from dataclasses import dataclass

from flask import Flask, Request, Response, abort, request

MOST_BODY = 64 * 1024
"""Maximum bytes of a request's body."""
ANY_ADDRESS = {"0.0.0.0", "::"}
"""A server that is bound to one of these is reachable under every address of the machine."""
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:;"
        " connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


@dataclass(frozen=True, slots=True)
class Guard:
    """Refuses requests that another site's page could make a browser send.

    The Host header reveals a page under a foreign name that resolves to this machine (DNS
    rebinding). Origin and Sec-Fetch-Site reveal a page of another origin. A request that changes
    something also needs the token, which only the person who started the server has.
    """

    hosts: frozenset[str]
    """Names and addresses that a Host header may have, lower case, without port."""
    token: str
    """The token that writing needs; if it is empty, nothing can be written."""

    @classmethod
    def of(cls, hosts: Collection[str], token: str) -> Guard:
        """Return the guard of a server that is reached under some names."""
        return cls(frozenset(host.lower() for host in hosts), token)

    def check(self, asked: Request) -> None:
        """Accept a request, or abort with 403."""
        host = asked.environ.get("HTTP_HOST", "").lower()
        if not self._is_ours(host):
            abort(403, "this server does not answer under that Host: use the address it printed")
        origin = asked.headers.get("Origin")
        if origin is not None and origin.lower() not in (f"http://{host}", f"https://{host}"):
            abort(403, "requests of another origin are refused")
        site = asked.headers.get("Sec-Fetch-Site", "same-origin")
        if site not in ("same-origin", "none") and not _opens_the_page(asked):
            abort(403, "requests of another site are refused")

    def check_writing(self, asked: Request) -> None:
        """Accept a request that changes something, or abort with 403 or 415."""
        if not self.token:
            abort(403, "nothing can be changed here: the server was started with --read-only")
        given = asked.headers.get("X-Token", "")
        if not hmac.compare_digest(given.encode(), self.token.encode()):
            abort(403, "to change something, open the link that the command printed")
        if asked.mimetype != "application/json":
            abort(415, "valid: a body of type application/json")

    def _is_ours(self, host: str) -> bool:
        name = _without_port(host)
        if name in self.hosts:
            return True
        return bool(ANY_ADDRESS & self.hosts) and _is_address(name)


def install(app: Flask, guard: Guard) -> None:
    """Make an app check every request first, and add the headers to every answer."""
    app.config["MAX_CONTENT_LENGTH"] = MOST_BODY

    @app.before_request
    def check() -> None:
        guard.check(request)

    @app.after_request
    def harden(answer: Response) -> Response:
        answer.headers.update(HEADERS)
        answer.headers.setdefault("Cache-Control", "no-store")
        return answer


def _without_port(host: str) -> str:
    """Return the host in a Host header without its port; an IPv6 address without its brackets."""
    name, colon, port = host.rpartition(":")
    if not colon or host.endswith("]"):
        name, port = host, "0"
    if not (port.isascii() and port.isdecimal()):
        return ""
    if name.startswith("[") and name.endswith("]"):
        return name[1:-1]
    return "" if ":" in name else name


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _opens_the_page(asked: Request) -> bool:
    """Return whether a request only opens the page, by a link; this changes nothing."""
    mode, target = asked.headers.get("Sec-Fetch-Mode"), asked.headers.get("Sec-Fetch-Dest")
    return (asked.method, asked.path, mode, target) == ("GET", "/", "navigate", "document")
