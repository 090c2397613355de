"""The routes: health, status page and data, stored reports, and the start of a run on command."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import cache
from importlib import resources
from typing import Any

from fastapi import FastAPI, Request
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse, JSONResponse, Response

from drivers.errors import TrueflankError
from drivers.local.names import is_file_name, shown
from gateway.errors import BusyError
from gateway.report.sentences import visible, when
from gateway.views import StatusView, as_data
from gateway.web.gate import REPORT_POLICY, Gate, is_same_origin, is_token

STATIC = {"status.css": "text/css", "status.js": "text/javascript", "icon.svg": "image/svg+xml"}
STATUS = {
    "E-WEB-PATH": 404,
    "E-WEB-REPORT": 404,
    "E-WEB-METHOD": 405,
    "E-WEB-TOKEN": 401,
    "E-WEB-ORIGIN": 403,
    "E-WEB-WATCHING": 409,
}

Picture = Callable[[], StatusView]
StartRun = Callable[[], Awaitable[str]]
Report = Callable[[str], str | None]


def create_app(picture: Picture, start_run: StartRun | None, token: str, report: Report | None = None) -> FastAPI:
    """The application. ``start_run`` starts a run that only proposes and returns its id; None refuses.

    ``token`` is what a caller must bear to start a run; ``report`` gives a stored report's HTML by run id,
    None when there is none. Answers that are not what was asked carry an error record as JSON.
    """
    app = FastAPI(title="trueflank", docs_url=None, redoc_url=None, openapi_url=None)
    app.add_middleware(Gate)
    app.add_exception_handler(TrueflankError, _ours)
    app.add_exception_handler(HTTPException, _theirs)
    _add_pages(app, picture, report)
    _add_start(app, start_run, token)
    return app


def _add_pages(app: FastAPI, picture: Picture, report: Report | None) -> None:
    @app.get("/healthz")
    async def healthz() -> dict[str, object]:
        alarms = picture().alarms
        return {"status": "alarm", "alarms": list(alarms)} if alarms else {"status": "ok"}

    @app.get("/")
    async def page() -> Response:
        return HTMLResponse(_page().render(status=picture()))

    @app.get("/api/status")
    async def data() -> Response:
        return JSONResponse(as_data(picture()))

    # A plain function runs in a thread: a report is a large file.

    @app.get("/runs/{run_id}/report")
    def stored(run_id: str) -> Response:
        return _report(run_id, report)

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        if name not in STATIC:
            raise TrueflankError("E-WEB-PATH", "web", path=f"/static/{name}")
        return Response(_static(name), media_type=STATIC[name])


def _add_start(app: FastAPI, start_run: StartRun | None, token: str) -> None:
    @app.post("/api/runs", status_code=202)
    async def start(request: Request) -> dict[str, str]:
        if not is_token(request.headers.get("authorization", ""), token):
            raise TrueflankError("E-WEB-TOKEN", "web")
        if not is_same_origin(request.headers):
            raise TrueflankError("E-WEB-ORIGIN", "web", origin=request.headers.get("origin", "another site"))
        if start_run is None:
            raise TrueflankError("E-WEB-WATCHING", "web")
        return {"run_id": await start_run()}


def _report(run_id: str, report: Report | None) -> Response:
    document = report(run_id) if is_file_name(run_id) and report is not None else None
    if document is None:
        raise TrueflankError("E-WEB-REPORT", "web", run=shown(run_id))
    return HTMLResponse(document, headers={"content-security-policy": REPORT_POLICY})


@cache
def _page() -> Any:
    environment = Environment(
        loader=PackageLoader("gateway.web", ""),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: visible(value) if isinstance(value, str) else value,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["when"] = when
    return environment.get_template("status.html.j2")


@cache
def _static(name: str) -> bytes:
    return resources.files("gateway.web").joinpath(name).read_bytes()


async def _ours(_request: Request, error: Exception) -> Response:
    if not isinstance(error, TrueflankError):
        raise error
    code = 409 if isinstance(error, BusyError) else STATUS.get(error.code, 503)
    headers = {"www-authenticate": "Bearer"} if code == 401 else {}
    return JSONResponse(error.as_record(), code, headers)


async def _theirs(request: Request, error: Exception) -> Response:
    """Map the framework's own refusals: no such path, wrong method."""
    status = error.status_code if isinstance(error, HTTPException) else 500
    if status == 405:
        ours = TrueflankError("E-WEB-METHOD", "web", method=request.method, path=request.url.path)
        allowed = dict(error.headers or {}) if isinstance(error, HTTPException) else {}
        return JSONResponse(ours.as_record(), 405, allowed)
    ours = TrueflankError("E-WEB-PATH", "web", path=request.url.path)
    return JSONResponse(ours.as_record(), status)
