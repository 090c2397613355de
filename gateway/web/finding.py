"""The routes that ask the index: runs by a text, a figure over time, what is due; of this site or its neighbours."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request

from gateway.web.doors import needs, service_of, site_of

routes = APIRouter(prefix="/api/v1/sites/{site}", tags=["index"], dependencies=[Depends(needs("viewer"))])
Most = Annotated[int, Query(ge=1, le=1000)]
Word = Annotated[str, Query(max_length=100)]

# Plain functions: each runs in a thread, where the index catches up with the folders first.


@routes.get("/search")
def search(request: Request, site: str, text: Word = "", serial: Word = "", most: Most = 100) -> dict[str, Any]:
    """Runs whose id, site, machine or state holds a text, newest first; in a shared database those of all gateways."""
    return {"runs": site_of(request, site).index.search(text, serial=serial, most=most)}


@routes.get("/trend")
def trend(
    request: Request,
    site: str,
    parameter: Word,
    serial: Word = "",
    subject: Word = "",
    phase: Word = "",
    before: Word = "",
    most: Annotated[int, Query(ge=1, le=10_000)] = 10_000,
) -> dict[str, Any]:
    """One parameter over time (E, R, B, A, M of an axis, rms of the flank), each with its U, oldest first.

    The newest ``most``; the page before it begins ``before`` the time of its first point.
    """
    index = site_of(request, site).index
    points = index.trend(parameter, serial=serial, subject=subject, phase=phase, before=before, most=most)
    return {"points": points}


@routes.get("/due")
def due(request: Request, site: str) -> dict[str, Any]:
    """When each machine's axes and flank were measured last, and when they are due."""
    return {"measured": site_of(request, site).index.due(service_of(request).clock.utc())}


@routes.get("/active-tables")
def active_tables(request: Request, site: str, serial: Word = "") -> dict[str, Any]:
    """The tables that should act in each machine by what was pushed, with id and date; a shared database's all."""
    return {"tables": site_of(request, site).index.tables(serial=serial)}


@routes.get("/compare")
def compare(request: Request, site: str, parameter: Word, subject: Word, phase: Word = "after") -> dict[str, Any]:
    """One error across machines: the newest figure of each, the largest first; in a shared database those of all."""
    return {"machines": site_of(request, site).index.compared(parameter, subject=subject, phase=phase)}
