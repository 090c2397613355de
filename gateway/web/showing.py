"""The routes of the operator's page: its files, its words in every language, and pictures that only it asks for."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request
from starlette.responses import Response

from gateway.approve import Approvals
from gateway.errors import InvalidRequest
from gateway.views.measurements import (
    bands_by,
    environment_of,
    figures_by,
    flank_at,
    form_of,
    known_standards,
    model_of,
)
from gateway.web import assets
from gateway.web.doors import needs, site_of
from gateway.web.reading import run_of

open_routes = APIRouter(include_in_schema=False)
routes = APIRouter(prefix="/api/v1", tags=["page"], dependencies=[Depends(needs("viewer"))])
Limits = Annotated[str, Query(max_length=400, description="parameter:limit, comma between, e.g. E:12,R:4")]
Sizes = Annotated[str, Query(max_length=600, description="error:multiple, comma between, e.g. EXX:0.5,B0Z:0")]
Steps = Annotated[str, Query(max_length=200, description="axis letter:spacing in mm or deg, e.g. X:20,C:7.2")]
Names = Annotated[str, Query(max_length=600, description="names of standards, comma between")]
Word = Annotated[str, Query(max_length=100)]


@open_routes.get("/")
async def page() -> Response:
    """The page, which knows nothing before somebody signs in at it; asked for each time, for it names its build."""
    return Response(assets.first_page(), media_type="text/html; charset=utf-8", headers={"cache-control": "no-cache"})


@open_routes.get("/static/{build}/{folder}/{name}")
def file(request: Request, build: str, folder: str, name: str) -> Response:
    """A style, script or text of the page."""
    return assets.served(request, build, folder, name)


@routes.get("/standards")
def every_standard(request: Request) -> list[dict[str, Any]]:  # noqa: ARG001 - the door's
    """Standards that figures can be had by, the newest ISO 230-2 first."""
    return known_standards()


@routes.get("/sites/{site}/taken")
async def taken(request: Request, site: str) -> list[dict[str, Any]]:
    """The readings of the plot that the command at work, or the last one, has taken so far; as the stream told them."""
    return [dict(one) for one in site_of(request, site).taken()]


@routes.get("/sites/{site}/air")
async def air(request: Request, site: str) -> list[dict[str, Any]]:
    """Air and material as they were read since the command at work, or the last one, began, oldest first."""
    return [dict(one) for one in site_of(request, site).airs()]


@routes.get("/sites/{site}/runs/{run}/environment")
def environment(request: Request, site: str, run: str) -> list[dict[str, Any]]:
    """Air and material at the start and the end of each capture of a run, oldest first."""
    return environment_of(run_of(site_of(request, site), run))


@routes.get("/sites/{site}/runs/{run}/bands/{axis}")
def bands(
    request: Request, site: str, run: str, axis: str, phase: Word = "before", standards: Names = ""
) -> dict[str, Any]:
    """What several standards count of an axis' capture at each target: lowest and highest, um or arcsec."""
    chosen = [one for one in standards.split(",") if one]
    return bands_by(run_of(site_of(request, site), run), axis, phase, chosen)


@routes.get("/sites/{site}/runs/{run}/approvals")
def approvals(request: Request, site: str, run: str) -> list[dict[str, str]]:
    """Approvals of a run's tables that no push has used: who gave each, and until when it holds."""
    folder = run_of(site_of(request, site), run)
    found = Approvals(folder.path).read_unused()
    return [{"by": one.actor, "plan_hash": one.plan_hash, "expires_utc": one.expires_utc} for one in found]


@routes.get("/sites/{site}/runs/{run}/figures/{axis}")
def figures(
    request: Request, site: str, run: str, axis: str, phase: Word = "before", standard: Word = "", limits: Limits = ""
) -> dict[str, Any]:
    """An axis' figures by a standard ("" is the stored evaluation), with U, judged against limits that are given."""
    folder = run_of(site_of(request, site), run)
    return figures_by(folder, axis, phase, name=standard, limits=_pairs("limits", limits))


@routes.get("/sites/{site}/runs/{run}/model")
def model(request: Request, site: str, run: str) -> dict[str, Any]:
    """A run's errors with their bands; with the site's gear their effects on the tooth, cures, what to measure next."""
    at = site_of(request, site)
    return model_of(run_of(at, run), at.site, at.path)


@routes.get("/sites/{site}/runs/{run}/flank")
def flank(
    request: Request, site: str, run: str, sizes: Sizes = "", steps: Steps = "", *, tables: bool = False
) -> dict[str, Any]:
    """The flank that the run's errors would leave, with some of them at other sizes; um, + surplus.

    With ``tables`` also what tables at the best for it leave, their points as far apart as ``steps`` says.
    """
    at = site_of(request, site)
    chosen = _pairs("steps", steps) if tables else None
    return flank_at(run_of(at, run), at.site, at.path, _pairs("sizes", sizes), steps=chosen)


@routes.get("/sites/{site}/runs/{run}/form")
def form(request: Request, site: str, run: str, stage: Word = "tooth") -> dict[str, Any]:
    """One space of the nominal gear at the points of a run's flank map: profile, normals, heights; mm and deg."""
    at = site_of(request, site)
    return form_of(run_of(at, run), at.site, at.path, stage)


@routes.get("/sites/{site}/runs/{run}/wheel/{part}")
def wheel(request: Request, site: str, run: str, part: str) -> dict[str, Any]:
    """A separated part: causes with u, the wheel's form now and after a dressing, the points of its axial profile."""
    from gateway.views.wheel import wheel_of  # noqa: PLC0415 - a service begins without what only this needs

    at = site_of(request, site)
    return wheel_of(run_of(at, run), at.site, at.path, part)


@routes.get("/sites/{site}/runs/{run}/wheel/{part}/points.{kind}")
def wheel_points(request: Request, site: str, run: str, part: str, kind: Literal["csv", "dxf"]) -> Response:
    """The same points as a file to take along: CSV, or DXF."""
    from gateway.views.wheel import KINDS, wheel_file  # noqa: PLC0415

    at = site_of(request, site)
    return Response(wheel_file(run_of(at, run), at.site, at.path, part=part, kind=kind), media_type=KINDS[kind])


def _pairs(key: str, text: str) -> dict[str, float]:
    pairs = [part.partition(":") for part in text.split(",") if part]
    try:
        return {name: float(value) for name, _, value in pairs}
    except ValueError as error:
        raise InvalidRequest("E-WEB-BODY", "web", why=f"{key}: NAME:NUMBER,NAME:NUMBER") from error
