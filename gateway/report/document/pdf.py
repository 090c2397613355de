"""A document as PDF/A-3 on A4 by typst: the content as data, the look from one template, results attached."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final, Literal, cast

import matplotlib as mpl
import typst

from drivers.message import words
from gateway.errors import StoreError
from gateway.report.document.content import Document
from gateway.report.document.plain import as_plain

PLAIN_FONTS = ("Liberation Sans", "Arial", "Helvetica", "DejaVu Sans")
# The newest and widest first: whatever the system has of these writes Chinese.
CJK_FONTS = (
    "Noto Sans CJK SC",
    "Noto Sans SC",
    "Source Han Sans SC",
    "Source Han Sans CN",
    "Microsoft YaHei",
    "PingFang SC",
    "WenQuanYi Micro Hei",
    "WenQuanYi Zen Hei",
    "Droid Sans Fallback",
    "SimHei",
    "SimSun",
)
NEED_CJK = ("zh",)
STANDARD: Final[Literal["a-3b"]] = "a-3b"


@dataclass(frozen=True, slots=True)
class Attached:
    """A file inside the PDF: its bytes, what kind they are, and what it holds in words."""

    name: str
    data: bytes
    mime: str
    words: str


def cjk_font() -> str:
    """The system's font for Chinese; "" where it has none."""
    known = set(_fonts().families())
    return next((name for name in CJK_FONTS if name in known), "")


def fonts_for(language: str) -> tuple[str, ...]:
    """Font families in the order they are tried. Raises StoreError (E-REPORT-FONT) where a language needs more."""
    chinese = cjk_font()
    if language in NEED_CJK and not chinese:
        raise StoreError("E-REPORT-FONT", "report", language=language, fonts=", ".join(CJK_FONTS))
    known = set(_fonts().families())
    found = tuple(name for name in PLAIN_FONTS if name in known)
    return (*found, chinese) if chinese else found


def pdf(document: Document, written: datetime, attached: tuple[Attached, ...] = ()) -> bytes:
    """The document as PDF/A-3b. Raises StoreError (E-REPORT-FONT, E-REPORT-PDF)."""
    found = as_plain(document, fonts_for(document.language))
    files = {"document.json": json.dumps(found.data).encode(), **found.files}
    for one in attached:
        files[one.name] = one.data
    files["main"] = (_template() + "".join(_attach(one) for one in attached)).encode()
    return _compiled(files, written)


def _attach(one: Attached) -> str:
    words = {"mime-type": one.mime, "description": one.words}
    said = ", ".join(f"{key}: {json.dumps(text, ensure_ascii=False)}" for key, text in words.items())
    return f'\n#pdf.attach({json.dumps(one.name)}, relationship: "data", {said})'


def _compiled(files: Mapping[str, bytes], written: datetime) -> bytes:
    try:
        made = typst.compile(
            cast(Any, dict(files)),
            font_paths=_fonts(),
            pdf_standards=[STANDARD],
            timestamp=written.replace(microsecond=0),
        )
    except typst.TypstError as error:
        raise StoreError("E-REPORT-PDF", "report", why=error.message) from error
    if not isinstance(made, bytes):
        raise StoreError("E-REPORT-PDF", "report", why=words("S-REPORT-NO-DOC"))
    return made


@cache
def _template() -> str:
    return resources.files("gateway.report.document").joinpath("document.typ").read_text(encoding="utf-8")


@cache
def _fonts() -> typst.Fonts:
    """The system's fonts and those that the drawings bring along, so that no machine is without any."""
    return typst.Fonts(font_paths=[Path(mpl.get_data_path()) / "fonts" / "ttf"])
