"""The routes that do something: commands to the machine, and what people keep, agree to and ask for meanwhile."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Request
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from drivers.message import words
from gateway import audit
from gateway.errors import BusyError, SignInRefused
from gateway.remaining import RemainingTime
from gateway.users import Person
from gateway.views import job_data
from gateway.web import bodies, works
from gateway.web.doors import needs, proved, service_of, site_of
from gateway.web.ports import ServedSite, Work
from gateway.web.reading import run_of

routes = APIRouter(prefix="/api/v1/sites/{site}", tags=["commands"])
Operator = Annotated[Person, Depends(needs("operator"))]
ServiceOrOperator = Annotated[Person, Depends(needs("operator", "service"))]
Anybody = Annotated[Person, Depends(needs("operator", "approver"))]
Key = Annotated[str, Header(alias="idempotency-key", max_length=200)]
MOST_KEYS = 500


class Asking:
    """One command's way to the desk: a key that was used for the same before gives the same answer, no second work."""

    def __init__(self, request: Request, at: ServedSite, person: Person, *, kind: str, key: str) -> None:
        self._keys, self._at, self._person = service_of(request).keys, at, person
        self._kind, self._key = kind, f"{at.site.site.name} {person.name} {key}" if key else ""

    def give(self, body: BaseModel, work: Work, remaining: RemainingTime | None = None) -> dict[str, Any]:
        """Give it; ``remaining`` reckons its time to go.

        Raises BusyError (E-WEB-BUSY, E-WEB-KEY: the key was used for something else).
        """
        same = hashlib.sha256(f"{self._kind} {body.model_dump_json()}".encode()).hexdigest()
        known = self._keys.get(self._key) if self._key else None
        if known is not None and known[0] != same:
            raise BusyError("E-WEB-KEY", "web")
        if known is not None:
            return dict(known[1])
        told = job_data(self._at.begin(work, kind=self._kind, who=self._person.name, remaining=remaining))
        if self._key:
            while len(self._keys) >= MOST_KEYS:
                del self._keys[next(iter(self._keys))]
            self._keys[self._key] = (same, told)
        return told


@routes.post("/commands/run", status_code=202)
async def run(request: Request, site: str, person: Operator, body: bodies.Plain, key: Key = "") -> dict[str, Any]:
    """Measure every axis and propose tables; nothing is written."""
    at = site_of(request, site)
    return Asking(request, at, person, kind="run", key=key).give(
        body, works.run(at, service_of(request).clock), works.remaining_of_run(at)
    )


@routes.post("/commands/measure", status_code=202)
async def measure(request: Request, site: str, person: Operator, body: bodies.Measure, key: Key = "") -> dict[str, Any]:
    """Measure the errors of the plan, set-up by set-up; with ``resume`` go on with a run."""
    at = site_of(request, site)
    work = works.measure(at, service_of(request).clock, tuple(body.setups), _maybe(at, body.resume))
    return Asking(request, at, person, kind="measure", key=key).give(
        body, work, works.remaining_of_measuring(at, tuple(body.setups))
    )


@routes.post("/commands/close", status_code=202)
async def close(request: Request, site: str, person: Operator, body: bodies.Close, key: Key = "") -> dict[str, Any]:
    """Measure all errors and propose for the tooth; with consent grind, push, grind again and prove it."""
    at = site_of(request, site)
    work = works.close(at, service_of(request).clock, body, _maybe(at, body.resume))
    return Asking(request, at, person, kind="close", key=key).give(
        body, work, works.remaining_of_closing(at, apply=body.apply)
    )


@routes.post("/commands/push", status_code=202)
async def push(request: Request, site: str, person: Operator, body: bodies.Push, key: Key = "") -> dict[str, Any]:
    """Show a stored proposal against the live machine; with ``apply`` and the machine's name write it and prove it."""
    at = site_of(request, site)
    work = works.push(run_of(at, body.run), service_of(request).clock, body)
    return Asking(request, at, person, kind="push", key=key).give(body, work)


@routes.post("/commands/disable", status_code=202)
async def disable(
    request: Request, site: str, person: ServiceOrOperator, body: bodies.Disable, key: Key = ""
) -> dict[str, Any]:
    """Say what a table does to its axis now; with ``apply`` switch it off."""
    at = site_of(request, site)
    work = works.disable(at, service_of(request).clock, body)
    return Asking(request, at, person, kind="disable", key=key).give(body, work)


@routes.post("/commands/roll-back", status_code=202)
async def roll_back(
    request: Request, site: str, person: Operator, body: bodies.RollBack, key: Key = ""
) -> dict[str, Any]:
    """Say what the last push of a table replaced; with ``apply`` put that table back."""
    at = site_of(request, site)
    work = works.roll_back(at, service_of(request).clock, body)
    return Asking(request, at, person, kind="roll-back", key=key).give(body, work)


@routes.post("/commands/recover", status_code=202)
async def recover(
    request: Request, site: str, person: ServiceOrOperator, body: bodies.Recover, key: Key = ""
) -> dict[str, Any]:
    """Say what an interrupted push left behind; with ``apply`` put it right."""
    at = site_of(request, site)
    work = works.recover(at, service_of(request).clock, body)
    return Asking(request, at, person, kind="recover", key=key).give(body, work)


@routes.post("/commands/verify-table", status_code=202)
async def verify_table(
    request: Request, site: str, person: Operator, body: bodies.Verify, key: Key = ""
) -> dict[str, Any]:
    """Compare the live tables with what was pushed, or with what a run proposed."""
    at = site_of(request, site)
    work = works.verify(at, service_of(request).clock, body, _maybe(at, body.run))
    return Asking(request, at, person, kind="verify-table", key=key).give(body, work)


@routes.post("/commands/self-test", status_code=202)
async def self_test(
    request: Request, site: str, person: Operator, body: bodies.SelfTestAsked, key: Key = ""
) -> dict[str, Any]:
    """Let the control try every word of our programs; a person starts it, nothing moves."""
    at = site_of(request, site)
    work = works.self_test(at, service_of(request).clock, body.axis)
    return Asking(request, at, person, kind="self-test", key=key).give(body, work)


@routes.post("/commands/doctor", status_code=202)
async def doctor(
    request: Request, site: str, person: ServiceOrOperator, body: bodies.Plain, key: Key = ""
) -> dict[str, Any]:
    """Look at the road to the control, line by line, and change nothing."""
    at = site_of(request, site)
    return Asking(request, at, person, kind="doctor", key=key).give(body, at.doctor)


@routes.post("/stop")
async def stop(request: Request, site: str, person: ServiceOrOperator, _body: bodies.Plain) -> dict[str, Any]:
    """Ask the command at work to end in order. This is no emergency stop: a motion goes on to its next wait."""
    asked = site_of(request, site).stop_job(words("W-STOP-AT-PAGE", name=person.name))
    return {"asked": asked}


@routes.post("/retake")
async def retake(request: Request, site: str, person: Operator, body: bodies.RetakeAsked) -> dict[str, Any]:
    """Have a reading taken again, when the run at work has visited all others of its axis."""
    at = site_of(request, site)
    if at.picture().run is None:
        raise BusyError("E-WEB-NO-RUN", "web")
    if not at.ask_again(body.axis, (body.target, body.repetition, body.approach)):
        raise BusyError("E-WEB-RETAKES", "web", axis=body.axis[:80])
    return {"asked": True, "by": person.name}


@routes.post("/runs/{run}/notes", status_code=201)
async def note(request: Request, site: str, run: str, person: Anybody, body: bodies.Note) -> dict[str, Any]:
    """Keep a word for those who come after; it stands in the audit log, by name and for good."""
    return _kept(request, site_of(request, site), run, person, action="note", told={"text": body.text})


@routes.post("/runs/{run}/mountings", status_code=201)
async def mounting(
    request: Request, site: str, run: str, person: Operator, body: bodies.MountingConfirmed
) -> dict[str, Any]:
    """Keep that a set-up is mounted as shown. What moves the machine is its own start key, never this."""
    told = {"setup": body.setup, "text": body.text}
    return _kept(request, site_of(request, site), run, person, action="mounting-confirmed", told=told)


def _kept(
    request: Request, at: ServedSite, run: str, person: Person, *, action: str, told: dict[str, str]
) -> dict[str, Any]:
    folder = run_of(at, run)
    details = {"run": folder.run_id, **told}
    clock, serial = service_of(request).clock, at.site.controller.serial
    head = audit.record(at.store.root, action, clock=clock, actor=person.name, serial=serial, details=details)
    return {"record": str(head), **details}


@routes.post("/runs/{run}/approve", status_code=201)
async def approve(request: Request, site: str, run: str, person: Anybody, body: bodies.Approve) -> list[dict[str, Any]]:
    """Approve a run's tables for ten minutes and one push.

    A second person signs for it with ``by`` and leaves the first one's session as it is.
    """
    at = site_of(request, site)
    if body.by is not None:
        secret = {"password": body.by.password, "pin": body.by.pin, "code": body.by.code}
        person = await proved(request, body.by.name, **secret)
    if not person.may("approver"):
        raise SignInRefused("E-WEB-ROLE", "web", name=person.name, roles="approver")
    service = service_of(request)
    account = service.doors.accounts.find(person.name)
    kept_by = account.kept_by(service.clock.utc()) if account is not None else ()
    asked = {"table": body.table, "typed_name": body.machine, "actor": person.name}
    made = await works.approved(run_of(at, run), service.clock, **asked, kept_by=kept_by, signer=person.signer)
    return [{"plan_hash": one.plan_hash, "by": one.actor, "expires_utc": one.expires_utc} for one in made]


@routes.post("/runs/{run}/report", status_code=201)
async def report(request: Request, site: str, run: str, _person: Operator, _body: bodies.Plain) -> dict[str, Any]:
    """Make a run's report anew from its records."""
    at = site_of(request, site)
    folder, now = run_of(at, run), at.picture().run
    if now is not None and now.run_id == folder.run_id:
        raise BusyError("E-WEB-BUSY", "web", run=now.run_id, who=now.who or "the service")
    paths = await run_in_threadpool(works.reported, folder)
    return {"run": folder.run_id, "report": paths.html.name}


def _maybe(at: ServedSite, run: str) -> Any:
    return run_of(at, run) if run else None
