"""The routes that only read: sites, runs and their records, the audit log, tables, the plan, and the live stream."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request
from starlette.responses import HTMLResponse, Response, StreamingResponse

from drivers.local.names import is_file_name, shown
from gateway import audit
from gateway.errors import NotFound, StoreError
from gateway.store import RUN_FILE, RunFolder
from gateway.store.machine_books import SelfTestBook
from gateway.users import Person
from gateway.views import as_data, job_data
from gateway.views.measurements import plan_of
from gateway.views.runs import has_report, sealed_file, standing_tables, stored_report
from gateway.web.doors import needs, person_of, service_of, session_of, site_of
from gateway.web.gate import REPORT_POLICY
from gateway.web.ports import ServedSite

routes = APIRouter(prefix="/api/v1", tags=["reading"], dependencies=[Depends(needs("viewer"))])
Viewer = Annotated[Person, Depends(needs("viewer"))]
TYPES = {".json": "application/json", ".png": "image/png", ".txt": "text/plain; charset=utf-8"}

# A plain function runs in a thread: what reads the disk never holds up the loop.


@routes.get("/sites")
async def sites(request: Request) -> list[dict[str, Any]]:
    """Every site of this service with its state in one word."""
    known = service_of(request).sites
    software = service_of(request).software
    return [{"site": name, "state": one.picture().state, "software": software} for name, one in known.items()]


@routes.get("/sites/{site}/status")
def status(request: Request, site: str) -> dict[str, Any]:
    """Everything as it is now: devices, the command at work, the newest runs, what is held, left, due or wrong."""
    return as_data(site_of(request, site).picture())


@routes.get("/sites/{site}/site-file")
def site_file(request: Request, site: str) -> dict[str, Any]:
    """The site file as it is served, defaults filled in; it holds no secret."""
    return dict(site_of(request, site).site.model_dump(mode="json"))


@routes.get("/sites/{site}/plan")
def plan(request: Request, site: str) -> dict[str, Any]:
    """What would be measured: the axes, and the set-ups in their order with what is mounted for each."""
    return plan_of(site_of(request, site).site)


@routes.get("/sites/{site}/runs")
def runs(
    request: Request, site: str, most: Annotated[int, Query(ge=1, le=500)] = 50, before: str = ""
) -> dict[str, Any]:
    """Stored runs, newest first, and whether each has a report; ``before`` goes on behind a run id."""
    store = site_of(request, site).store
    found = store.newest(most + 1, before)
    seen = map(store.summary, found[:most])
    listed = [{**asdict(one), "path": str(one.path), "report": has_report(store, one.run_id)} for one in seen]
    return {"runs": listed, "more": len(found) > most}


@routes.get("/sites/{site}/runs/{run}")
def run_facts(request: Request, site: str, run: str) -> dict[str, Any]:
    """A run's facts: state, machine, stages with their hashes, files, errors, and the notes people left."""
    at = site_of(request, site)
    folder = run_of(at, run)
    facts = {key: value for key, value in folder.facts.items() if key not in ("plan", "errors")}
    notes = [one for one in audit.read_entries(at.store.root) if _is_note(one, folder.run_id)]
    return {**facts, "run_id": folder.run_id, "errors": [dict(one) for one in folder.errors], "notes": notes}


def _is_note(entry: dict[str, Any], run_id: str) -> bool:
    return entry.get("action") in ("note", "mounting-confirmed") and entry["details"].get("run") == run_id


@routes.get("/sites/{site}/runs/{run}/stages/{stage}")
def stage(request: Request, site: str, run: str, stage: str) -> dict[str, Any]:
    """One record of a run as it is stored, its hash checked."""
    folder = run_of(site_of(request, site), run)
    return {"stage": stage, "sha256": folder.digest(stage), **folder.envelope(stage)}


@routes.get("/sites/{site}/runs/{run}/files/{name}")
def run_file(request: Request, site: str, run: str, name: str) -> Response:
    """One file of a run as it is stored, its hash checked; pages and programs are sent as plain text."""
    folder = run_of(site_of(request, site), run)
    ending = name[name.rfind(".") :] if "." in name else ""
    data = sealed_file(folder, name)
    return Response(data, media_type=TYPES.get(ending, "text/plain; charset=utf-8" if _is_text(data) else None))


def _is_text(data: bytes) -> bool:
    return b"\0" not in data[:4096]


@routes.get("/sites/{site}/runs/{run}/report", response_class=HTMLResponse)
def report(request: Request, site: str, run: str) -> Response:
    """A run's report page as stored; it can run no script."""
    known = is_file_name(run)
    document = stored_report(site_of(request, site).store, run) if known else None
    if document is None:
        raise NotFound("E-WEB-REPORT", "web", run=shown(run))
    return HTMLResponse(document, headers={"content-security-policy": REPORT_POLICY})


@routes.get("/sites/{site}/audit")
def audit_log(request: Request, site: str, last: Annotated[int, Query(ge=1, le=1000)] = 100) -> dict[str, Any]:
    """The newest records of who did what, oldest first, and whether each is as it was written."""
    root = site_of(request, site).store.root
    return {"records": list(deque(audit.read_entries(root), maxlen=last)), "head": audit.current_head(root)}


@routes.get("/sites/{site}/tables")
def tables(request: Request, site: str) -> dict[str, Any]:
    """What pushes left in the control: each table with its id, date and points, alarms, and pushes that did not end."""
    at = site_of(request, site)
    return standing_tables(at.store, at.site.controller.serial)


@routes.get("/sites/{site}/self-tests")
def self_tests(request: Request, site: str) -> list[dict[str, Any]]:
    """The last self-test of each axis."""
    at = site_of(request, site)
    found = SelfTestBook(at.store.root).all(at.site.controller.serial)
    return [
        {"axis": one.axis, "utc": one.utc, "ok": one.ok, "missed": one.missed, "version": one.machine.version}
        for one in found
    ]


@routes.get("/sites/{site}/jobs")
async def jobs(request: Request, site: str) -> list[dict[str, Any]]:
    """The newest commands and how they stand or ended, newest first."""
    return [job_data(one) for one in site_of(request, site).jobs()]


@routes.get("/sites/{site}/jobs/{job}")
async def job(request: Request, site: str, job: int) -> dict[str, Any]:
    """One command: how it stands, or what it came to."""
    found = next((one for one in site_of(request, site).jobs() if one.job == job), None)
    if found is None:
        raise NotFound("E-WEB-JOB", "web", job=job)
    return job_data(found)


@routes.get("/sites/{site}/stream", response_class=StreamingResponse)
async def stream(request: Request, site: str) -> Response:
    """The live stream as server-sent events: picture, said, reading, waiting, taken, state; lost where frames were."""
    person = person_of(request)
    who = "" if person.by == "terminal" else person.name  # programs at this computer are not one person's windows
    found = site_of(request, site).stream(who, operates=person.may("operator"))
    bearer = "authorization" in request.headers
    return StreamingResponse(_while_signed_in(request, found, bearer=bearer), media_type="text/event-stream")


async def _while_signed_in(request: Request, frames: AsyncIterator[str], *, bearer: bool) -> AsyncIterator[str]:
    async for frame in frames:
        if not bearer and session_of(request, touch=False) is None:
            return
        yield frame


def run_of(at: ServedSite, run: str) -> RunFolder:
    """A run of a site's store by its id, and by nothing else. Raises TrueflankError (E-WEB-RUN)."""
    with contextlib.suppress(StoreError):
        if is_file_name(run) and (at.store.root / run / RUN_FILE).is_file():
            return RunFolder(at.store.root / run)
    raise NotFound("E-WEB-RUN", "web", run=shown(run))
