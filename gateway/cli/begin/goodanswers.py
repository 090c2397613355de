"""What will do as an answer to a question of `init` about instruments, gear and optics; else why it will not."""

from __future__ import annotations

import re
from pathlib import Path

from drivers import registry
from drivers.errors import TrueflankError
from gateway.cli.begin.questions import Why, why
from gateway.cli.begin.siteparts import OPTICS

NONE, SAMPLE = "none", "example"
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")


def instrument(text: str) -> Why | None:
    """A driver and an address that it opens."""
    parts, known = text.split(maxsplit=1), registry.known("instrument")
    if len(parts) != 2 or parts[0] not in known:
        return why("W-INIT-INSTRUMENT", known=", ".join(known))
    return reached(parts[0], "instrument", parts[1])


def reached(driver: str, role: str, url: str) -> Why | None:
    """Whether a driver opens this kind of address."""
    from gateway.config import address_of

    wrong = address_of(driver, role, url)
    return None if wrong is None else why(wrong[0], **wrong[1])


def with_height(text: str) -> tuple[str, float]:
    """A gear file and the height behind it, mm; 0 where none is given."""
    name, _, height = text.rpartition(" ")
    return (name.strip(), float(height)) if name and _NUMBER.fullmatch(height) else (text.strip(), 0.0)


def gear_file(text: str, folder: Path) -> Why | None:
    """A gear file beside the site file, the example, or none."""
    from gateway.study.inputs import load_gear

    name, _ = with_height(text)
    if text == NONE or name == SAMPLE:
        return None
    try:
        load_gear(folder / name)
    except (TrueflankError, OSError) as error:
        # The answer names the file already.
        return why("W-INIT-GEAR", why=error.what if isinstance(error, TrueflankError) else error)
    return None


def optics(text: str) -> Why | None:
    """Optics by their names, each with or without a driver and an address."""
    if text == NONE:
        return None
    parts = [part.split(maxsplit=1) for part in text.split(",")]
    names = [part[0] for part in parts if part]
    if len(names) < len(parts) or len(set(names)) < len(names) or not set(names) <= set(OPTICS):
        return why("W-INIT-OPTICS", known=", ".join(OPTICS))
    return next(filter(None, (instrument(part[1]) for part in parts if len(part) > 1)), None)
