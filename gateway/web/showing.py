"""The routes of the operator's page: its files, its words in every language, and pictures that only it asks for."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request
from starlette.responses import HTMLResponse, Response

from drivers.errors import catalogue
from drivers.languages import LANGUAGES, page_texts
from drivers.local.names import is_file_name
from drivers.terms import spoken_texts
from gateway.approve import Approvals
from gateway.audience import kind_of
from gateway.errors import InvalidRequest, NotFound
from gateway.views.measurements import figures_by, flank_at, known_standards, model_of
from gateway.web.doors import needs, site_of
from gateway.web.reading import run_of

open_routes = APIRouter(include_in_schema=False)
routes = APIRouter(prefix="/api/v1", tags=["page"], dependencies=[Depends(needs("viewer"))])
KINDS = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
Limits = Annotated[str, Query(max_length=400, description="parameter:limit, comma between, e.g. E:12,R:4")]
Sizes = Annotated[str, Query(max_length=600, description="error:multiple, comma between, e.g. EXX:0.5,B0Z:0")]
Word = Annotated[str, Query(max_length=100)]


@open_routes.get("/")
async def page() -> Response:
    """The page, which knows nothing before somebody signs in at it."""
    return HTMLResponse(_file("index.html"))


@open_routes.get("/static/page/{name}")
async def file(name: str) -> Response:
    """A style or script of the page."""
    kind = KINDS.get(name[name.rfind(".") :]) if is_file_name(name) else None
    if kind is None or not resources.files("gateway.web").joinpath("page", name).is_file():
        raise NotFound("E-WEB-PATH", "web", path=f"/static/page/{name[:80]}")
    return Response(_file(name), media_type=kind)


@open_routes.get("/static/words/{language}.json")
def texts(language: str) -> Response:
    """Every sentence of the page and every text of the catalogue in one language, English where one is missing."""
    if language not in LANGUAGES:
        raise NotFound("E-WEB-PATH", "web", path=f"/static/words/{language[:20]}.json")
    return Response(json.dumps(_words(language), ensure_ascii=False), media_type="application/json")


def _words(language: str) -> dict[str, Any]:
    page = page_texts(language)
    known = {**catalogue(), **({} if language == "en" else catalogue(language))}
    return {
        "page": dict(page),
        "codes": {
            code: [*(_at_page(one[part], page) for part in ("what", "do")), kind_of(code).value]
            for code, one in known.items()
        },
        "terms": spoken_texts(),
    }


_KEYS = {
    "recover --apply": ("push.recover_apply", "frame.push"),
    "recover --finish": ("push.recover_finish", "frame.push"),
    "recover --undo": ("push.recover_undo", "frame.push"),
    "recover": ("push.recover", "frame.push"),
    "disable": ("push.disable", "frame.push"),
    "rollback": ("push.roll_back", "frame.push"),
    "push": ("push.show", "frame.push"),
    "approve": ("push.approve", "frame.push"),
    "doctor": ("connect.examine", "frame.connect"),
    "trust show": ("trust.look", "frame.connect"),
    "trust accept": ("trust.accept", "frame.connect"),
    "trust": ("trust.look", "frame.connect"),
    "self-test": ("capture.self_test", "frame.capture"),
    "run": ("capture.measure_axes", "frame.capture"),
    "measure": ("capture.measure_errors", "frame.capture"),
    "verify-table": ("push.verify", "frame.push"),
    "report": ("report.make", "frame.report"),
}
"""Commands that texts of the catalogue name, and the key of the page that does the same, with its screen."""
_COMMAND = re.compile(
    r"`?\btrueflank (trust show|trust accept|[a-z][a-z-]*)"
    r"((?: (?:SITE\b|NAME\b|\{site\}|[^\s`]+\.toml\b|\.\.\.|--[a-z-]+|(?<=--axis )(?:[\w-]+|\{\w+\})))*)`?"
    r"(?: with the site file| mit der Anlagendatei)?"
)
_SIGNS = (("->", "→"), ("+/-", "±"), ("+-", "±"))


def _at_page(text: str, page: Mapping[str, str]) -> str:
    """A text of the catalogue as the page shows it: commands as its keys, signs as in print."""

    def key(found: re.Match[str]) -> str:
        name, more = found[1], found[2]
        flag = next((one for one in ("--finish", "--undo", "--apply") if one in more and f"{name} {one}" in _KEYS), "")
        at = _KEYS.get(f"{name} {flag}".strip())
        if at is None:
            return found[0]
        return page["order.key"].replace("{key}", page[at[0]]).replace("{screen}", page[at[1]])

    said = _COMMAND.sub(key, text)
    for typed, printed in _SIGNS:
        said = said.replace(typed, printed)
    return said


@cache
def _file(name: str) -> bytes:
    return resources.files("gateway.web").joinpath("page", name).read_bytes()


@routes.get("/standards")
def every_standard(request: Request) -> list[dict[str, Any]]:  # noqa: ARG001 - the door's
    """Standards that figures can be had by, the newest ISO 230-2 first."""
    return known_standards()


@routes.get("/sites/{site}/taken")
async def taken(request: Request, site: str) -> list[dict[str, Any]]:
    """The readings of the plot that the command at work, or the last one, has taken so far; as the stream told them."""
    return [dict(one) for one in site_of(request, site).taken()]


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
def flank(request: Request, site: str, run: str, sizes: Sizes = "") -> dict[str, Any]:
    """The flank that the run's errors would leave uncorrected, with some of them at other sizes; um, + surplus."""
    at = site_of(request, site)
    return flank_at(run_of(at, run), at.site, at.path, _pairs("sizes", sizes))


def _pairs(key: str, text: str) -> dict[str, float]:
    pairs = [part.partition(":") for part in text.split(",") if part]
    try:
        return {name: float(value) for name, _, value in pairs}
    except ValueError as error:
        raise InvalidRequest("E-WEB-BODY", "web", why=f"{key}: NAME:NUMBER,NAME:NUMBER") from error
