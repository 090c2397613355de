"""Who asks, and whether they may: every route but health, the sign-in and its files begins here."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Awaitable, Callable

from fastapi import Request
from starlette.concurrency import run_in_threadpool
from starlette.requests import HTTPConnection

from drivers.local.names import person_key
from drivers.message import fixed
from gateway.audit import os_user
from gateway.errors import NotFound, NotSignedIn, SignInRefused, StoreError, TooManyTries
from gateway.users import ROLES, Person, Session, UserRole
from gateway.web.gate import is_same_origin, is_token, network_of
from gateway.web.ports import ServedSite, Service

COOKIE = "trueflank-session"
BROWSER = "trueflank-browser"
CSRF = "x-csrf-token"
HARMLESS = frozenset({"GET", "HEAD"})


def service_of(request: HTTPConnection) -> Service:
    """What this application serves."""
    found: Service = request.app.state.service
    return found


def session_of(request: HTTPConnection, *, touch: bool = True) -> Session | None:
    """The session that a request's cookie opens; None where there is none."""
    key = request.cookies.get(COOKIE, "")
    return service_of(request).doors.sessions.find(key, touch=touch) if key else None


def site_of(request: Request, site: str) -> ServedSite:
    """A served site by its name. Raises TrueflankError (E-WEB-SITE)."""
    known = service_of(request).sites
    if site not in known:
        raise NotFound("E-WEB-SITE", "web", site=site[:80], known=", ".join(known))
    return known[site]


def person_of(request: Request) -> Person:
    """Who asks: by a bearer's token, else by the session's cookie.

    What changes something must come from our own page, and with a cookie bear the session's own key as well. Raises
    SignInRefused (E-WEB-TOKEN, E-WEB-LOGIN, E-WEB-ORIGIN, E-WEB-CSRF).
    """
    harmless = request.method in HARMLESS
    header = request.headers.get("authorization", "")
    person = _bearer(request, header) if header else _signed_in(request, harmless=harmless)
    if not harmless and not is_same_origin(request.headers, secure=service_of(request).doors.secure):
        raise SignInRefused("E-WEB-ORIGIN", "web", origin=request.headers.get("origin", "another site")[:80])
    return person


def _bearer(request: Request, header: str) -> Person:
    person = _bearing(request, header)
    if person is None:
        raise NotSignedIn("E-WEB-TOKEN", "web")
    return person


def _bearing(request: HTTPConnection, header: str) -> Person | None:
    doors = service_of(request).doors
    if is_token(header, doors.terminal):
        # Who can read the state folder is at this computer and may do there what its command line does.
        return Person(os_user(), frozenset(ROLES) - {"approver"}, "terminal")
    scheme, _, token = header.partition(" ")
    if scheme.lower() != "bearer" or not token.strip():
        return None
    return doors.accounts.by_token(token.strip(), service_of(request).clock.utc())


def known_of(request: HTTPConnection) -> Person | None:
    """Who is signed in with a request, whatever it may do then; None for a stranger. Keeps no session open."""
    if header := request.headers.get("authorization", ""):
        with contextlib.suppress(StoreError):  # the route says so, to those whom it concerns
            return _bearing(request, header)
        return None
    session = session_of(request, touch=False)
    return session.person if session is not None else None


def _signed_in(request: Request, *, harmless: bool) -> Person:
    session = session_of(request)
    if session is None:
        raise NotSignedIn("E-WEB-LOGIN", "web")
    given = request.headers.get(CSRF, "").encode("utf-8", "replace")
    if not harmless and not secrets.compare_digest(given, session.csrf.encode("ascii")):
        raise SignInRefused("E-WEB-CSRF", "web")
    return session.person


def needs(*roles: UserRole) -> Callable[[Request], Awaitable[Person]]:
    """A dependency: who asks has one of these roles. Raises SignInRefused (E-WEB-ROLE and what `person_of` raises)."""

    async def door(request: Request) -> Person:
        person = person_of(request)
        if not any(person.may(role) for role in roles):
            raise SignInRefused("E-WEB-ROLE", "web", name=person.name, roles=" or ".join(roles))
        return person

    door.roles = roles  # type: ignore[attr-defined]
    return door


async def proved(request: Request, name: str, *, password: str = "", pin: str = "", code: str = "") -> Person:
    """Who a name and a secret prove to be, and a code where the account has a second factor.

    It is bounded, and never on the event loop.

    An address has a budget, and each name at an address another: nobody can lock a name out at other addresses, and
    what is refused unheard counts nowhere. A browser that somebody has signed in with before has a budget of its own.
    Raises SignInRefused (E-USER-WAIT, E-USER-SECRET, E-USER-CODE).
    """
    doors, utc = service_of(request).doors, service_of(request).clock.utc()
    address, known = network_of(request), request.cookies.get(BROWSER, "")
    keys = [f"address {address}", f"name {person_key(name)} at {address}"]
    if known and doors.browsers.knows(known, name):
        keys = [f"browser {known}"]
    wait = max(doors.tries.wait_s(key) for key in keys)
    if wait > 0.0:
        raise TooManyTries("E-USER-WAIT", "sign-in", seconds=fixed(wait, 0))
    for key in keys:
        doors.tries.count(key)
    async with doors.secrets_at_once:
        person = await run_in_threadpool(doors.accounts.by_secret, name, password=password, pin=pin)
        await run_in_threadpool(doors.accounts.take_code, name, code, utc)
    for key in keys:
        doors.tries.forget(key)
    return person
