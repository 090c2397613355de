"""The routes of signing in and of accounts: first start, sign-in and sign-out, who I am, users and their tokens."""

from __future__ import annotations

import secrets
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import JSONResponse, Response

from gateway.errors import NotSignedIn, RecordNotFound, SignInRefused, TooManyTries
from gateway.users import ROLES, Person, Session, UserAccount
from gateway.web.bodies import FirstStart, Plain, SignIn, UserBody
from gateway.web.doors import BROWSER, COOKIE, needs, proved, service_of, session_of
from gateway.web.gate import address_of, is_same_origin

BROWSER_S = 90 * 24 * 3600
open_routes = APIRouter(prefix="/api/v1", tags=["signing in"])
routes = APIRouter(prefix="/api/v1", tags=["accounts"])
Viewer = Annotated[Person, Depends(needs("viewer"))]
ServiceRole = Annotated[Person, Depends(needs("service"))]


def _from_own_page(request: Request) -> None:
    if not is_same_origin(request.headers, secure=service_of(request).doors.secure):
        raise SignInRefused("E-WEB-ORIGIN", "web", origin=request.headers.get("origin", "another site")[:80])


@open_routes.post("/login")
async def sign_in(request: Request, body: SignIn) -> Response:
    """Sign in with a password or a PIN; the answer sets the session's cookie and tells its key for changes."""
    _from_own_page(request)
    service = service_of(request)
    try:
        person = await proved(request, body.name, password=body.password, pin=body.pin)
    except SignInRefused:
        service.doors.refused.add(body.name[:60], address_of(request), service.clock.utc())
        raise
    service.note("sign-in", actor=person.name, details={"how": "PIN" if body.pin else "password"})
    return _begun(request, person)


@open_routes.post("/first-start")
async def first_start(request: Request, body: FirstStart) -> Response:
    """Make the first account, which has every role, with the token of the first start; it is signed in at once."""
    _from_own_page(request)
    service = service_of(request)
    doors = service.doors
    if (wait := doors.tries.wait_s("first start")) > 0.0:
        raise TooManyTries("E-USER-WAIT", "first start", seconds=f"{wait:.0f}")
    doors.tries.count("first start")
    wanted = doors.accounts.first_token().encode("ascii")
    if not wanted or not secrets.compare_digest(body.token.strip().encode("utf-8", "replace"), wanted):
        raise NotSignedIn("E-USER-FIRST", "first start")
    account = await run_in_threadpool(doors.accounts.put, body.name, ROLES, password=body.password)
    service.note("first-account", actor=account.name)
    return _begun(request, account.person())


def _begun(request: Request, person: Person) -> Response:
    doors = service_of(request).doors
    doors.sessions.end(request.cookies.get(COOKIE, ""))  # a key from before the sign-in is never taken over
    key, session = doors.sessions.begin(person)
    answer = JSONResponse(_told(request, person, session))
    answer.set_cookie(COOKIE, key, httponly=True, samesite="strict", secure=doors.secure, path="/")
    browser = doors.browsers.remember(request.cookies.get(BROWSER, ""), person.name)
    answer.set_cookie(
        BROWSER, browser, max_age=BROWSER_S, httponly=True, samesite="strict", secure=doors.secure, path="/api/v1/login"
    )
    return answer


def _told(request: Request, person: Person, session: Session | None) -> dict[str, Any]:
    doors = service_of(request).doors
    told: dict[str, Any] = {"name": person.name, "roles": sorted(person.roles), "by": person.by}
    if session is not None:
        told |= {"csrf": session.csrf, "idle_s": doors.sessions.idle_s, "left_s": round(doors.sessions.left_s(session))}
    return told


@routes.post("/logout")
async def sign_out(request: Request, person: Viewer, _body: Plain | None = None) -> Response:
    """End this session."""
    service_of(request).doors.sessions.end(request.cookies.get(COOKIE, ""))
    service_of(request).note("sign-out", actor=person.name)
    answer = JSONResponse({"name": person.name})
    answer.delete_cookie(COOKIE, path="/")
    return answer


@routes.get("/me")
async def who_am_i(request: Request, person: Viewer) -> dict[str, Any]:
    """Who is signed in, with which roles, and for how long; asking does not keep a session open."""
    return _told(request, person, session_of(request, touch=False) if person.by == "session" else None)


@routes.get("/users")
async def users(request: Request, _person: ServiceRole) -> list[dict[str, Any]]:
    """Every account; no secret and no hash of one."""
    return [_shown(one) for one in service_of(request).doors.accounts.all()]


def _shown(account: UserAccount) -> dict[str, Any]:
    has = {"pin": bool(account.pin), "token": bool(account.token)}
    return {"name": account.name, "roles": list(account.roles), **has}


@routes.put("/users/{name}")
async def put_user(request: Request, person: ServiceRole, name: str, body: UserBody) -> dict[str, Any]:
    """Make an account or change one; whoever is signed in with it must sign in again."""
    doors = service_of(request).doors
    known = doors.accounts.find(name)
    secret = {"password": body.password, "pin": body.pin}
    by = (person.name, service_of(request).clock.utc())
    account = await run_in_threadpool(doors.accounts.put, name, tuple(body.roles), **secret, known=known, by=by)
    doors.sessions.end_of(name)
    service_of(request).note("user-changed" if known else "user-made", actor=person.name, details=_details(account))
    return _shown(account)


def _details(account: UserAccount) -> dict[str, str]:
    return {"name": account.name, "roles": ", ".join(account.roles)}


@routes.delete("/users/{name}")
async def remove_user(request: Request, person: ServiceRole, name: str) -> dict[str, Any]:
    """Take an account away."""
    doors = service_of(request).doors
    if not doors.accounts.remove(name):
        raise RecordNotFound("E-USER-NONE", "users", name=name[:80])
    doors.sessions.end_of(name)
    service_of(request).note("user-removed", actor=person.name, details={"name": name})
    return {"name": name}


@routes.post("/users/{name}/token")
async def give_token(request: Request, person: ServiceRole, name: str, _body: Plain | None = None) -> dict[str, Any]:
    """A new token for a program that acts as this account; it is shown this once."""
    service = service_of(request)
    token = service.doors.accounts.give_token(name, (person.name, service.clock.utc()))
    service_of(request).note("user-token", actor=person.name, details={"name": name})
    return {"name": name, "token": token}
