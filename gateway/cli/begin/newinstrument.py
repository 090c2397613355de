"""The command `new-instrument`: the package of a driver for an instrument of one's own, tested and green at once."""

from __future__ import annotations

import keyword
import re
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from drivers import registry
from drivers.errors import ConfigError, words
from gateway.cli.show import echo

NAME = re.compile(r"[a-z][a-z0-9_]{1,29}")
TEMPLATE = ".template"


def new_instrument_command(
    name: Annotated[
        str, typer.Argument(help="Name of the driver, as a site file will give it: lower-case letters, digits, _.")
    ],
    folder: Annotated[Path | None, typer.Option(help="Folder to create; trueflank-NAME if not given.")] = None,
) -> None:
    """Write a package with a driver for an instrument of your own: codec, settings, device, simulator and tests."""
    check_name(name)
    target = folder or Path(f"trueflank-{name}")
    written = write_package(name, target)
    fields = {"name": name, "count": len(written), "folder": target}
    echo(words("P-INIT-PACKAGE", **fields), colour="green")
    echo(words("P-INIT-PACKAGE", "do", **fields))


def check_name(name: str) -> None:
    """Raises ConfigError (E-INIT-PACKAGE-NAME) for a name that no Python package and no driver can have."""
    why = ""
    if NAME.fullmatch(name) is None:
        why = "2 to 30 lower-case letters, digits and _, beginning with a letter"
    elif keyword.iskeyword(name):
        why = "a word of Python"
    elif name in registry.known():
        why = "trueflank has a driver of this name"
    elif find_spec(name) is not None:
        why = "a Python package of this name is installed"
    if why:
        raise ConfigError("E-INIT-PACKAGE-NAME", name, why=why)


def write_package(name: str, target: Path) -> list[Path]:
    """Write the files of the package into a folder that does not exist yet, and return them.

    Raises ConfigError: E-INIT-PACKAGE-EXISTS where the folder exists, E-CLI-WRITE where it cannot be written.
    """
    title = "".join(part.capitalize() for part in name.split("_"))
    try:
        target.mkdir(parents=True)
    except FileExistsError as error:
        raise ConfigError("E-INIT-PACKAGE-EXISTS", str(target)) from error
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(target), why=str(error)) from error
    written = []
    for path, template in _templates(files("gateway.cli.begin") / "instrument"):
        place = target / Path(*(f"src/{name}" if part == "src" else part for part in path))
        place.parent.mkdir(parents=True, exist_ok=True)
        text = template.read_text(encoding="utf-8").replace("@name@", name).replace("@Name@", title)
        place.write_text(text, encoding="utf-8")
        written.append(place)
    return written


def _templates(folder: Traversable, above: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], Traversable]]:
    found: list[tuple[tuple[str, ...], Traversable]] = []
    for entry in sorted(folder.iterdir(), key=lambda one: one.name):
        if entry.is_dir():
            found += _templates(entry, (*above, entry.name))
        elif entry.name.endswith(TEMPLATE):
            found.append(((*above, entry.name.removesuffix(TEMPLATE)), entry))
    return found
