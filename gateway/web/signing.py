"""The routes of signing in and of accounts: first start, sign-in and sign-out, own sessions, users and their tokens."""

from __future__ import annotations

import secrets
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import JSONResponse, Response

from drivers.message import fixed
from gateway.errors import NotSignedIn, RecordNotFound, SignInRefused, TooManyTries
from gateway.users import ROLES, Person, ProgramToken, Session, UserAccount, factor_uri, new_factor
from gateway.web.bodies import FirstStart, OwnFactor, OwnSecret, Plain, SignIn, TokenBody, UserBody
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
        person = await proved(request, body.name, password=body.password, pin=body.pin, code=body.code)
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
        raise TooManyTries("E-USER-WAIT", "first start", seconds=fixed(wait, 0))
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
    key, session = doors.sessions.begin(person, address_of(request), request.headers.get("user-agent", ""))
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
    accounts = service_of(request).doors.accounts
    return [_shown(one, accounts.tokens_of(one)) for one in accounts.all()]


def _shown(account: UserAccount, tokens: tuple[ProgramToken, ...]) -> dict[str, Any]:
    has = {"pin": bool(account.pin), "token": bool(tokens), "second_factor": bool(account.factor)}
    told = [_token_shown(one) for one in tokens]
    return {"name": account.name, "roles": list(account.roles), **has, "system": list(account.system), "tokens": told}


def _token_shown(one: ProgramToken) -> dict[str, str]:
    return {"id": one.id, "made_utc": one.made_utc, "ends_utc": one.ends_utc, "used_utc": one.used_utc}


@routes.put("/users/{name}")
async def put_user(request: Request, person: ServiceRole, name: str, body: UserBody) -> dict[str, Any]:
    """Make an account or change one; whoever is signed in with it must sign in again."""
    doors = service_of(request).doors
    known = doors.accounts.find(name)
    asked: dict[str, Any] = {"password": body.password, "pin": body.pin, "known": known, "system": body.system}
    asked |= {"by": (person.name, service_of(request).clock.utc()), "forget_factor": body.forget_factor}
    account = await run_in_threadpool(doors.accounts.put, name, tuple(body.roles), **asked)
    doors.sessions.end_of(name)
    service_of(request).note("user-changed" if known else "user-made", actor=person.name, details=_details(account))
    return _shown(account, doors.accounts.tokens_of(account))


def _details(account: UserAccount) -> dict[str, str]:
    return {"name": account.name, "roles": ", ".join(account.roles), "system": ", ".join(account.system)}


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
async def give_token(request: Request, person: ServiceRole, name: str, body: TokenBody | None = None) -> dict[str, Any]:
    """A new token for a program that acts as this account; it is shown this once, and ends after ``days`` days."""
    service = service_of(request)
    days = (body or TokenBody()).days
    token, made = service.doors.accounts.give_token(name, service.clock.utc(), by=person.name, days=days)
    told = {"name": name, "id": made.id, "until": made.ends_utc}
    service.note("user-token", actor=person.name, details=told)
    return {"name": name, "token": token, **_token_shown(made)}


@routes.delete("/users/{name}/tokens/{token}")
async def end_token(request: Request, person: ServiceRole, name: str, token: str) -> dict[str, Any]:
    """End a program's token by its id."""
    service = service_of(request)
    if not service.doors.accounts.end_token(name, token):
        raise RecordNotFound("E-USER-NO-TOKEN", "users", name=name[:80], id=token[:80])
    service.note("user-token-ended", actor=person.name, details={"name": name, "id": token})
    return {"name": name, "id": token}


# What a person does with the own account; a program's token, or the one of this computer, is no person here.


@routes.get("/me/sessions")
async def own_sessions(request: Request, person: Viewer) -> list[dict[str, Any]]:
    """Where this person is signed in: address, browser, age and last use in seconds."""
    sessions, own = service_of(request).doors.sessions, session_of(request, touch=False)
    told = []
    for one in sessions.of(person.name):
        begun_s, seen_s = sessions.age_s(one)
        ages = {"begun_s": round(begun_s), "seen_s": round(seen_s), "this": one is own}
        told.append({"id": one.id, "address": one.address, "browser": one.browser, **ages})
    return told


@routes.delete("/me/sessions/{ended}")
async def end_own_session(request: Request, person: Viewer, ended: str) -> dict[str, Any]:
    """End one of the own sessions by its id, or with "others" all but this one."""
    service, own = service_of(request), session_of(request, touch=False)
    but = own.id if own is not None and ended == "others" else ""
    count = service.doors.sessions.end_of(person.name, "" if ended == "others" else ended, but)
    if not count and ended != "others":
        raise RecordNotFound("E-USER-NO-SESSION", "sessions", id=ended[:80])
    service.note("sessions-ended", actor=person.name, details={"count": count})
    return {"ended": count}


async def _proved_own(request: Request, person: Person, proof: SignIn) -> Person:
    """This person, who gives the own secret once more. Raises SignInRefused (E-WEB-LOGIN, E-USER-SECRET ...)."""
    if person.by != "session":
        raise NotSignedIn("E-WEB-LOGIN", "web")
    return await proved(request, person.name, password=proof.password, pin=proof.pin, code=proof.code)


@routes.put("/me/secret")
async def own_secret(request: Request, person: Viewer, body: OwnSecret) -> dict[str, Any]:
    """Change the own password or PIN; every other session ends, and a new password ends the tokens."""
    service, own = service_of(request), session_of(request, touch=False)
    signer = (await _proved_own(request, person, body.old)).signer
    secret: dict[str, Any] = {"password": body.password, "pin": body.pin, "signer": signer}
    await run_in_threadpool(service.doors.accounts.change_secret, person.name, **secret)
    service.doors.sessions.end_of(person.name, but=own.id if own is not None else "")
    service.note("own-secret-changed", actor=person.name)
    return {"name": person.name}


@routes.get("/me/second-factor")
async def offered_factor(request: Request, person: Viewer) -> dict[str, Any]:
    """A new secret for an authenticator, which counts once a code of it is sent back; and whether one is in use."""
    secret = new_factor()
    known = service_of(request).doors.accounts.find(person.name)
    used = known is not None and bool(known.factor)
    return {"secret": secret, "uri": factor_uri(secret, person.name), "second_factor": used}


@routes.put("/me/second-factor")
async def own_factor(request: Request, person: Viewer, body: OwnFactor) -> dict[str, Any]:
    """Take a second factor into use, or (``secret`` "") do without it again."""
    service = service_of(request)
    accounts = service.doors.accounts
    await _proved_own(request, person, body.proof)
    if body.secret:
        await run_in_threadpool(accounts.set_factor, person.name, body.secret, body.code, service.clock.utc())
    else:
        await run_in_threadpool(accounts.forget_factor, person.name)
    service.note("second-factor-set" if body.secret else "second-factor-gone", actor=person.name)
    return {"name": person.name, "second_factor": bool(body.secret)}
