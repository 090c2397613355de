"""The routes of a machine's beginning: its site file by questions, its control's certificate, what it is known by."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request
from starlette.concurrency import run_in_threadpool

from drivers.checks import TrustView
from drivers.errors import ConfigError
from gateway.users import Person
from gateway.web.bodies import SiteAnswers, Thumbprint
from gateway.web.doors import needs, service_of, site_of
from gateway.web.ports import Making
from gateway.workflow.run.folder import known_of
from gateway.workflow.run.identity import accept_certificate, shown_certificate

routes = APIRouter(prefix="/api/v1", tags=["beginning"])
ServiceRole = Annotated[Person, Depends(needs("service"))]


def _making(request: Request) -> Making:
    found = service_of(request).making
    if found is None:
        raise ConfigError("E-WEB-SITE-THERE", "web")
    return found


@routes.post("/site-file/question")
async def question(request: Request, person: ServiceRole, body: SiteAnswers) -> dict[str, Any]:
    """The next question for a site file behind these answers; the control is asked where they lead to it."""
    making = _making(request)
    return dict(await run_in_threadpool(making.site.ask, body.answers, person.name, anew=body.anew))


@routes.post("/site-file", status_code=201)
async def write(request: Request, person: ServiceRole, body: SiteAnswers) -> dict[str, Any]:
    """Write the site file; the service then opens its devices and goes on at the same address."""
    making = _making(request)
    told = dict(await run_in_threadpool(making.site.write, body.answers, person.name))
    if told["made"]:
        service_of(request).note("site-file-made", actor=person.name, details={"file": told["file"]})
        making.made.set()
    return told


@routes.get("/sites/{site}/trust")
async def trust(request: Request, site: str, _person: ServiceRole) -> dict[str, Any]:
    """The certificate that the control shows now, beside the pinned one; nothing changes."""
    at = site_of(request, site)
    return _told(await shown_certificate(at.site, service_of(request).clock))


@routes.post("/sites/{site}/trust", status_code=201)
async def accept(request: Request, site: str, person: ServiceRole, body: Thumbprint) -> dict[str, Any]:
    """Pin what the control shows now, if the thumbprint that was read at the control itself is its own."""
    at, clock = site_of(request, site), service_of(request).clock
    return _told(await accept_certificate(at.site, at.path, body.thumbprint, who=person.name, clock=clock))


@routes.get("/sites/{site}/identity")
def identity(request: Request, site: str, _person: ServiceRole) -> dict[str, Any]:
    """What the machine is known by, and each change of it that a person accepted: who, when and why; oldest first."""
    at = site_of(request, site)
    known = known_of(at.site, at.store.root)
    return {"facts": dict(known.facts), "accepted": [{**one.fields, "utc": one.utc} for one in known.accepted]}


def _told(view: TrustView) -> dict[str, Any]:
    return {**asdict(view), "equal": view.equal}
