"""What lets a site file's reader into a control: kept in files of their own that only their owner reads."""

from __future__ import annotations

import secrets
from pathlib import Path

from drivers.local.ownfiles import open_own
from gateway.cli.begin.questions import Questioner

TOKEN, TOKEN_BYTES = "token.txt", 24
PASSWORD, VARIABLE = "password.txt", "TRUEFLANK_PASSWORD"


def token(asker: Questioner, folder: Path) -> dict[str, str]:
    """Where the agent's token is; a new one is made where there is none, for its host as well."""
    place = folder / TOKEN
    if not place.exists():
        with open_own(place, "wb", secret=True) as file:
            file.write(f"{secrets.token_urlsafe(TOKEN_BYTES)}\n".encode())
        asker.tell("P-INIT-TOKEN", path=str(place))
    return {"token_file": TOKEN}


def password(asker: Questioner, folder: Path) -> dict[str, str]:
    """Where the password is; a typed one goes into a file that only its owner reads, and into no site file."""
    place = folder / PASSWORD
    if place.exists():
        return {"password_file": PASSWORD}
    typed = asker.ask("password", "P-INIT-PASSWORD", "", secret=True)
    if not typed:
        return {"password_env": VARIABLE}
    with open_own(place, "wb", secret=True) as file:
        file.write(f"{typed}\n".encode())
    return {"password_file": PASSWORD}
