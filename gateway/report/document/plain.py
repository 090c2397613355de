"""A document as plain values for a template: each block by its kind, each picture as a file of its own."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields

from gateway.report.document.content import Block, Document, Pair, PictureBlock, Whole
from gateway.report.document.drawn import in_language
from gateway.report.sentences import visible

MICRO = re.compile(r"(?<=\d )um\b|\bum(?=/m\b)")
"""The unit after a number: German has a word that is written alike, "um die Achse"."""
NAMESPACES = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '


@dataclass(frozen=True, slots=True)
class PlainDocument:
    """The document as JSON data, and the files that it names."""

    data: Mapping[str, object]
    files: Mapping[str, bytes]


def as_plain(document: Document, fonts: tuple[str, ...]) -> PlainDocument:
    """Everything a template needs; texts are without what no reader can see."""
    files: dict[str, bytes] = {}
    logo = ""
    head = document.letterhead
    if head.logo:
        logo = f"logo.{head.logo_ending}"
        files[logo] = head.logo
    letterhead = {"name": visible(head.name), "lines": [visible(line) for line in head.lines], "logo": logo}
    own = ("letterhead", "blocks")
    said = {one.name: _value(getattr(document, one.name)) for one in fields(document) if one.name not in own}
    blocks = [_block(one, files, document.language) for one in document.blocks]
    return PlainDocument({**said, "letterhead": letterhead, "blocks": blocks, "fonts": list(fonts)}, files)


def _block(block: Block, files: dict[str, bytes], language: str) -> dict[str, object]:
    if isinstance(block, PictureBlock):
        name = f"picture-{len(files) + 1}.svg"
        files[name] = in_language(block.svg.replace("<svg ", NAMESPACES, 1), language).encode()
        return {"kind": block.kind, "file": name, "width_mm": block.width_mm, "caption": _text(block.caption)}
    if isinstance(block, Pair):
        sides = {side: [_block(one, files, language) for one in getattr(block, side)] for side in ("left", "right")}
        return {"kind": block.kind, "share": block.share, **sides}
    if isinstance(block, Whole):
        return {"kind": block.kind, "blocks": [_block(one, files, language) for one in block.blocks]}
    return {"kind": block.kind, **{one.name: _value(getattr(block, one.name)) for one in fields(block)}}


def _value(value: object) -> object:
    if isinstance(value, str):
        return _text(value)
    return [_value(item) for item in value] if isinstance(value, tuple) else value


def _text(text: str) -> str:
    # What records and terminals write in ASCII.
    return visible(MICRO.sub("µm", text).replace(" +- ", " ± ").replace(" +/- ", " ± ").replace(" -> ", " → "))
