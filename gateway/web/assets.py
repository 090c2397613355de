"""The page's files as they are sent: one name for each build, compressed once, kept by browsers for good.

Every path holds a hash of all files and texts together, so that a path never changes its content: browsers keep it
(`immutable`), and an update has other paths. Modules import each other by relative paths, which stay in their build.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from drivers.errors import catalogue
from drivers.languages import LANGUAGES, page_texts
from drivers.local.names import is_file_name
from drivers.terms import spoken_texts
from gateway.audience import kind_of
from gateway.errors import NotFound

KINDS = {
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".svg": "image/svg+xml",
}
FOREVER = "public, max-age=31536000, immutable"
FIRST = "main.js"
_IMPORT = re.compile(r'^(?:import|export|\}) .*?from "\./([a-z0-9]+\.js)";$', re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Asset:
    """One file: its type, its bytes, and the same compressed."""

    media_type: str
    plain: bytes
    packed: bytes

    def answer(self, request: Request, *, forever: bool) -> Response:
        """To a browser, compressed where it takes that."""
        headers = {"cache-control": FOREVER if forever else "no-cache", "vary": "accept-encoding"}
        if "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(self.plain, media_type=self.media_type, headers=headers)
        headers["content-encoding"] = "gzip"
        return Response(self.packed, media_type=self.media_type, headers=headers)


def _asset(media_type: str, plain: bytes) -> Asset:
    return Asset(media_type, plain, gzip.compress(plain, 9, mtime=0))


@cache
def asset(folder: str, name: str) -> Asset | None:
    """A file of the folder page, vendor, words or codes; None where there is none."""
    kind = KINDS.get(name[name.rfind(".") :]) if is_file_name(name) else None
    if kind is None:
        return None
    if folder in ("words", "codes"):
        language = name.removesuffix(".json")
        if language not in LANGUAGES:
            return None
        return _asset(kind, _json(words(language) if folder == "words" else codes(language)))
    file = resources.files("gateway.web").joinpath(folder, name)
    return _asset(kind, file.read_bytes()) if folder in ("page", "vendor") and file.is_file() else None


def served(request: Request, build_name: str, folder: str, name: str) -> Response:
    """A file by its path; one of another build is sent as it is now, and not kept. Raises NotFound (E-WEB-PATH)."""
    found = asset(folder, name)
    if found is None:
        raise NotFound("E-WEB-PATH", "web", path=f"/static/{build_name[:20]}/{folder[:20]}/{name[:80]}")
    return found.answer(request, forever=build_name == build())


def words(language: str) -> dict[str, Any]:
    """What the page itself says, and the terms that fill its sentences: all that its first picture needs."""
    return {"page": dict(page_texts(language)), "terms": spoken_texts()}


def codes(language: str) -> dict[str, Any]:
    """Every text of the catalogue, English where one is missing: what, do, and the kind of word it is."""
    page = page_texts(language)
    known = {**catalogue(), **({} if language == "en" else catalogue(language))}
    return {
        code: [*(_at_page(one[part], page) for part in ("what", "do")), kind_of(code).value]
        for code, one in known.items()
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
    "doctor certificate --thumbprint": ("trust.accept", "frame.connect"),
    "doctor certificate": ("trust.look", "frame.connect"),
    "doctor self-test": ("capture.self_test", "frame.capture"),
    "run": ("capture.measure_axes", "frame.capture"),
    "measure": ("capture.measure_errors", "frame.capture"),
    "tables verify": ("push.verify", "frame.push"),
    "report": ("report.make", "frame.report"),
}
"""Commands that texts of the catalogue name, and the key of the page that does the same, with its screen."""
_COMMAND = re.compile(
    r"`?\btrueflank (doctor certificate|doctor self-test|tables verify|[a-z][a-z-]*)"
    r"((?: (?:SITE\b|NAME\b|\{site\}|[^\s`]+\.toml\b|\.\.\.|--[a-z-]+|(?<=--axis )(?:[\w-]+|\{\w+\})))*)`?"
    r"(?: with the site file| mit der Anlagendatei)?"
)
_SIGNS = (("->", "→"), ("+/-", "±"), ("+-", "±"))


def _at_page(text: str, page: Mapping[str, str]) -> str:
    """A text of the catalogue as the page shows it: commands as its keys, signs as in print."""

    def key(found: re.Match[str]) -> str:
        name, more = found[1], found[2]
        flag = next(
            (
                one
                for one in ("--finish", "--undo", "--apply", "--thumbprint")
                if one in more and f"{name} {one}" in _KEYS
            ),
            "",
        )
        at = _KEYS.get(f"{name} {flag}".strip())
        if at is None:
            return found[0]
        return page["order.key"].replace("{key}", page[at[0]]).replace("{screen}", page[at[1]])

    said = _COMMAND.sub(key, text)
    for typed, printed in _SIGNS:
        said = said.replace(typed, printed)
    return said


@cache
def build() -> str:
    """The name of this build: a hash of all that it serves."""
    made = hashlib.sha256()
    for folder in ("page", "vendor"):
        for path in sorted(resources.files("gateway.web").joinpath(folder).iterdir(), key=lambda one: one.name):
            if path.is_file():
                made.update(path.name.encode() + b"\0" + path.read_bytes())
    for language in LANGUAGES:
        made.update(_json([words(language), codes(language)]))
    return made.hexdigest()[:12]


@cache
def first_page() -> bytes:
    """The page with the paths of this build, and every module that its first picture needs named ahead."""
    at = f"/static/{build()}/page"
    ahead = "\n".join(f'<link rel="modulepreload" href="{at}/{name}">' for name in first_modules())
    text = resources.files("gateway.web").joinpath("page", "index.html").read_text(encoding="utf-8")
    return text.replace("{page}", at).replace("{ahead}", ahead).encode("utf-8")


def first_modules() -> list[str]:
    """The modules that the first one imports, over others too; one that is loaded by its tab is imported there."""
    folder = resources.files("gateway.web").joinpath("page")
    found, todo = dict.fromkeys([FIRST]), [FIRST]
    while todo:
        for name in _IMPORT.findall(folder.joinpath(todo.pop()).read_text(encoding="utf-8")):
            if name not in found:
                found[name] = None
                todo.append(name)
    return list(found)


def _json(data: object) -> bytes:
    return json.dumps(data, ensure_ascii=False, separators=(",", ":")).encode("utf-8")
