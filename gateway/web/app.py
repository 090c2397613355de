"""The application: health, sign-in and static files for all, everything else for who may; errors as records."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Annotated, Any

from fastapi import Depends, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse, JSONResponse, Response

from drivers.errors import ConfigError, OtherCertificate, TrueflankError
from gateway.errors import (
    BusyError,
    CodeAsked,
    InvalidRequest,
    LastAdministrator,
    ModelError,
    NotFound,
    NotSignedIn,
    SignInRefused,
    TooManyTries,
    WriteRefused,
)
from gateway.report.sentences import visible, when
from gateway.users import Person
from gateway.views import StatusView
from gateway.web import beginning, commanding, finding, metrics, reading, showing, signing
from gateway.web.doors import known_of, needs, service_of, site_of
from gateway.web.gate import Gate
from gateway.web.ports import Service

API_VERSION = "1.0.0"
STATIC = {
    "status.css": "text/css",
    "status.js": "text/javascript",
    "icon.svg": "image/svg+xml",
}
STATUS: tuple[tuple[type[TrueflankError], int], ...] = (
    (TooManyTries, 429),
    (CodeAsked, 428),
    (NotSignedIn, 401),
    (SignInRefused, 403),
    (NotFound, 404),
    (InvalidRequest, 422),
    (OtherCertificate, 422),
    (BusyError, 409),
    (WriteRefused, 409),
    (ConfigError, 409),
    (ModelError, 409),
    (LastAdministrator, 409),
)
"""The HTTP status of an error: of the first class in this order that it belongs to; 503 for all others."""
Viewer = Annotated[Person, Depends(needs("viewer"))]


def create_app(service: Service) -> FastAPI:
    """The application of a service. Answers that are not what was asked carry an error record as JSON."""
    app = routed()
    app.state.service = service
    app.add_middleware(Gate, known=known_of)
    app.add_exception_handler(TrueflankError, _ours)
    app.add_exception_handler(RequestValidationError, _unfit)
    app.add_exception_handler(HTTPException, _theirs)
    app.add_exception_handler(Exception, _fault)
    return app


def routed() -> FastAPI:
    """Every route without a service behind it: enough to describe them."""
    app = FastAPI(
        title="trueflank", version=API_VERSION, docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False
    )
    for router in (
        signing.open_routes,
        signing.routes,
        beginning.routes,
        showing.open_routes,
        showing.routes,
        reading.routes,
        finding.routes,
        metrics.routes,
        commanding.routes,
    ):
        app.include_router(router)
    _add_open(app)
    _add_pages(app)
    return app


def _add_open(app: FastAPI) -> None:
    @app.get("/healthz", tags=["health"])
    async def healthz(request: Request) -> dict[str, Any]:
        """Whether the service works; an alarm is a live table that is not as it was pushed."""
        service = service_of(request)
        first = {"first_start": True} if service.doors.accounts.waits_for_first else {}
        return {**service.health(), **first}

    @app.get("/static/{name}", include_in_schema=False)
    async def static(name: str) -> Response:
        if name not in STATIC:
            raise NotFound("E-WEB-PATH", "web", path=f"/static/{name}")
        return Response(_static(name), media_type=STATIC[name])

    @app.get("/status", include_in_schema=False)
    async def plain(request: Request, _person: Viewer, site: str = "") -> Response:
        """The plain status page, which needs no script."""
        return HTMLResponse(_page("status.html.j2").render(status=_picture(request, site)))


def _picture(request: Request, site: str) -> StatusView:
    sites = service_of(request).sites
    return site_of(request, site or next(iter(sites), "")).picture()


def _add_pages(app: FastAPI) -> None:
    @app.get("/api/v1/openapi.json", tags=["reading"])
    async def document(request: Request, _person: Viewer) -> dict[str, Any]:
        """This description of all routes."""
        described: dict[str, Any] = request.app.openapi()
        return described


@cache
def _page(name: str) -> Any:
    environment = Environment(
        loader=PackageLoader("gateway.web", ""),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: visible(value) if isinstance(value, str) else value,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["when"] = when
    return environment.get_template(name)


@cache
def _static(name: str) -> bytes:
    return resources.files("gateway.web").joinpath(name).read_bytes()


def _status(error: TrueflankError) -> int:
    return next((status for kind, status in STATUS if isinstance(error, kind)), 503)


async def _ours(_request: Request, error: Exception) -> Response:
    if not isinstance(error, TrueflankError):
        raise error
    code = _status(error)
    headers = {"www-authenticate": "Bearer"} if code == 401 else {}
    return JSONResponse(error.as_record(), code, headers)


async def _fault(_request: Request, error: Exception) -> Response:
    """What nobody foresaw: its kind and nothing else leaves the program; the log has the rest."""
    return JSONResponse(TrueflankError("E-WEB-FAULT", "web", why=type(error).__name__).as_record(), 500)


async def _unfit(_request: Request, error: Exception) -> Response:
    """A body or query that is not what the route takes: where and why, never the value, which may be a secret."""
    found = error.errors() if isinstance(error, RequestValidationError) else []
    why = "; ".join(f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in found[:5])
    return JSONResponse(InvalidRequest("E-WEB-BODY", "web", why=why[:500]).as_record(), 422)


async def _theirs(request: Request, error: Exception) -> Response:
    """Map the framework's own refusals: no such path, wrong method."""
    status = error.status_code if isinstance(error, HTTPException) else 500
    if status == 405:
        ours = TrueflankError("E-WEB-METHOD", "web", method=request.method, path=request.url.path)
        allowed = dict(error.headers or {}) if isinstance(error, HTTPException) else {}
        return JSONResponse(ours.as_record(), 405, allowed)
    if status == 400:
        return JSONResponse(InvalidRequest("E-WEB-BODY", "web", why="no JSON").as_record(), 422)
    ours = NotFound("E-WEB-PATH", "web", path=request.url.path)
    return JSONResponse(ours.as_record(), status)
