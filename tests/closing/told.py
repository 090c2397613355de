"""Whether what a run leaves is fit to be read: no number that is none, no word of Python, no path of this computer."""

from __future__ import annotations

import re
from pathlib import Path

NOT_NUMBERS = re.compile(r"(?<![\w.])(?:NaN|nan|[+-]?Infinity|[+-]?inf|None)(?![\w.])")
BINARY = {".png", ".npy", ".der", ".pem"}
# The copy of a site file is the site's own words.
SITE_COPY = "site.toml"


def unfit(run: Path) -> list[str]:
    """Every place in the files of a run folder that says what nobody should read."""
    here = str(run.resolve().parents[1])
    found = []
    files = sorted(one for one in run.rglob("*") if one.is_file() and one.suffix not in BINARY)
    for path in (one for one in files if one.name != SITE_COPY):
        text = path.read_text(encoding="utf-8")
        found += [f"{path.name}: {_around(text, one.start())}" for one in NOT_NUMBERS.finditer(_words(path, text))]
        found += [f"{path.name}: {_around(text, text.index(here))}"] if here in text else []
    return found


def _words(path: Path, text: str) -> str:
    """What is read: of a page without its drawings' geometry and style, of anything else all."""
    if path.suffix != ".html":
        return text
    return re.sub(r"<(style|script|path|defs)\b.*?</\1>|<[^>]*>", lambda one: " " * len(one.group()), text, flags=re.S)


def _around(text: str, place: int) -> str:
    return " ".join(text[max(place - 50, 0) : place + 50].split())
