"""Which packages of an extra are not installed, by what the installed metadata say belongs to it."""

from __future__ import annotations

import re
from importlib import metadata

from drivers.errors import ConfigError

DISTRIBUTION = "trueflank"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def missing(extra: str) -> tuple[str, ...]:
    """Names of the packages that ``extra`` asks for and that are not installed; none where trueflank itself is not."""
    try:
        asked = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        return ()
    of_it = [one for one in asked if re.search(rf"extra\s*==\s*['\"]{re.escape(extra)}['\"]", one)]
    names = [found.group(0) for one in of_it if (found := NAME.match(one))]
    return tuple(name for name in names if not _installed(name))


def need(extra: str, where: str) -> None:
    """Raise ConfigError (E-EXTRA-MISSING) that names the extra, where a package of it is not installed."""
    if absent := missing(extra):
        raise ConfigError("E-EXTRA-MISSING", where, extra=extra, packages=", ".join(absent))


def _installed(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True
