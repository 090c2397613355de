"""A document as one HTML page without any foreign request: the same blocks as on paper, every text escaped."""

from __future__ import annotations

import base64
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from gateway.report.document.content import Document
from gateway.report.document.plain import as_plain

MIME = {"svg": "image/svg+xml", "png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg"}


def page(document: Document) -> str:
    """The whole page. Same document, same text."""
    found = as_plain(document, ())
    drawn = {name: _drawn(data) for name, data in found.files.items() if name.startswith("picture-")}
    head = document.letterhead
    logo = ""
    if head.logo:
        logo = f"data:{MIME[head.logo_ending]};base64,{base64.b64encode(head.logo).decode('ascii')}"
    return _template().render(d=found.data, drawn=drawn, logo=logo)


def _drawn(svg: bytes) -> Markup:
    # Our own drawing, whose texts matplotlib has escaped as XML.
    return Markup(svg.decode())  # noqa: S704


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("gateway.report.document", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("document.html.j2")
