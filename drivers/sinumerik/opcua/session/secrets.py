"""Password and certificates of a login, read from where the settings of a control point."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from cryptography import x509

from drivers.errors import ConfigError
from drivers.local.names import shown
from drivers.sinumerik.opcua.session import certificates
from drivers.sinumerik.opcua.session.certificates import KeyPair
from drivers.sinumerik.opcua.settings import POLICIES, UaSettings

APPLICATION_URI = "urn:trueflank:gateway"


@dataclass(frozen=True, slots=True)
class Secrets:
    """What a login needs, read from where the settings point: ``pinned`` and ``own`` are None without security.

    ``policies`` may be used, best first. ``excuse`` is why a person accepted the pinned certificate although it was
    not valid; "" where nobody did.
    """

    user: str
    password: str
    pinned: x509.Certificate | None = None
    own: KeyPair | None = None
    policies: tuple[str, ...] = POLICIES
    excuse: str = ""


def secrets_of(settings: UaSettings, where: str) -> Secrets:
    """Read password and certificates; blocking.

    Raises ConfigError (E-UA-SECRET, E-UA-SECRET-ENV, E-UA-UNPINNED) naming key, file and why.
    """
    told = _password(settings.password_env, settings.password_file, "password_file", where)
    password = settings.password if told is None else told
    if not settings.secured:
        return Secrets(settings.user, password)
    path = settings.server_certificate
    if not Path(path).is_file():
        raise ConfigError("E-UA-UNPINNED", where, path=path)
    try:
        pinned = certificates.load(_content("server_certificate", path, where))
    except ValueError as error:
        raise ConfigError("E-UA-SECRET", where, key="server_certificate", path=path, why=str(error)) from error
    folder = client_folder(settings)
    try:
        own = certificates.own_key_pair(folder, "trueflank", APPLICATION_URI, "localhost")
    except OSError as error:
        raise ConfigError("E-UA-SECRET", where, key="client_folder", path=str(folder), why=str(error)) from error
    given = {"user": settings.user, "password": password, "policies": settings.policies}
    return Secrets(**given, pinned=pinned, own=own, excuse=certificates.excuse_of(Path(path)))  # type: ignore[arg-type]


def writing_of(settings: UaSettings, secrets: Secrets, where: str) -> Secrets | None:
    """The same login of the account that writes; None where one account does all. Raises as `secrets_of`."""
    if not settings.writing_user:
        return None
    key = "writing_password_file"
    told = _password(settings.writing_password_env, settings.writing_password_file, key, where)
    return replace(secrets, user=settings.writing_user, password=told or "")


def _password(variable: str, path: str, key: str, where: str) -> str | None:
    """From a file or the environment; None where neither is named."""
    if path:
        return _content(key, path, where).decode("utf-8", errors="replace").strip("\r\n")
    if not variable:
        return None
    found = os.environ.get(variable, "")
    if not found:
        raise ConfigError("E-UA-SECRET-ENV", where, name=shown(variable))
    return found


def client_folder(settings: UaSettings) -> Path:
    """Where this gateway's own certificate and key lie: beside the pinned one unless the settings name a folder."""
    beside = Path(settings.server_certificate).parent / "trueflank-client"
    return Path(settings.client_folder) if settings.client_folder else beside


def _content(key: str, path: str, where: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise ConfigError("E-UA-SECRET", where, key=key, path=path, why=str(error)) from error
