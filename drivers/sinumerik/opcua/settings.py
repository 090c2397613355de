"""What a site file may say about a control behind OPC UA, and the secrets it points to."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography import x509

from drivers.errors import ConfigError
from drivers.link import read_settings, wrong_setting
from drivers.local.names import shown
from drivers.sinumerik.ncprogram.words import COUNT, SetupWord, Words
from drivers.sinumerik.opcua.session import certificates, nodes
from drivers.sinumerik.opcua.session.certificates import KeyPair

APPLICATION_URI = "urn:trueflank:gateway"
# Best first; both sign and encrypt. The last one is what every control has.
POLICIES = ("Aes256_Sha256_RsaPss", "Basic256Sha256")
BEST, NONE = "best", "None"


@dataclass(frozen=True, slots=True)
class UaSettings:
    """Keys under ``[controller.settings]``.

    ``security`` "best" (the better one of those the server offers), "Aes256_Sha256_RsaPss" or "Basic256Sha256" (each
    signs and encrypts, the server's certificate pinned), or "None", which must be asked for. The password is in
    ``password_file`` or in the environment variable ``password_env``; ``password`` itself is for programs, a site
    file may not hold it. ``client_folder`` keeps our own certificate; beside the pinned one when empty. ``r_first`` is
    the first of 20 R parameters; ``r_setup`` the first of three for the set-up values of a test part, -1: the three
    before ``r_first`` (behind its 20 where there is no room).
    ``two_programs`` for controls that give no file out while a program waits.
    ``approach_feed`` mm/min or deg/min; ``wait_limit_s`` NC seconds after which a program left alone ends.
    ``stale_s``: a machine state older than this by the server's own time stamps does not count; 0 asks for none.
    ``serial_node`` and ``version_node`` because their paths are not public.
    """

    user: str = ""
    password: str = ""
    password_file: str = ""
    password_env: str = ""
    security: str = BEST
    server_certificate: str = ""
    client_folder: str = ""
    r_first: int = 80
    r_setup: int = -1
    channel: int = 1
    two_programs: bool = False
    poll_s: float = 0.05
    fast_poll_s: float = 0.002
    approach_feed: float = 2000.0
    wait_limit_s: float = 14400.0
    stale_s: float = 1.0
    serial_node: str = nodes.SERIAL_NUMBER
    version_node: str = nodes.NCK_VERSION

    @classmethod
    def read(cls, settings: Mapping[str, Any], where: str) -> UaSettings:
        """From the site file. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE)."""
        found = read_settings(cls, settings, where)
        for key, good, why in found.limits():
            if not good:
                raise wrong_setting(key, why, where)
        return found

    def limits(self) -> tuple[tuple[str, bool, str], ...]:
        """Key, whether its value is allowed, and what is allowed."""
        pinned = not self.secured or bool(self.server_certificate)
        return (
            ("security", self.security in (BEST, *POLICIES, NONE), f"must be {BEST}, {', '.join(POLICIES)} or {NONE}"),
            ("server_certificate", pinned, "must name the server's certificate: nothing is trusted unseen"),
            ("password_file", self._one_password(), "give one of password_file, password_env and password"),
            ("r_first", 0 <= self.r_first <= nodes.R_LAST - COUNT, f"must be 0 .. {nodes.R_LAST - COUNT}"),
            ("r_setup", self._free(), f"must be 0 .. {nodes.R_LAST - 2}, clear of the 20 from r_first on, or -1"),
            ("channel", 1 <= self.channel <= 10, "must be 1 .. 10"),
            ("poll_s", 0.02 <= self.poll_s <= 5.0, "must be 0.02 .. 5 s"),
            ("fast_poll_s", 0.001 <= self.fast_poll_s <= self.poll_s, "must be 0.001 s .. poll_s"),
            ("approach_feed", 0.0 < self.approach_feed <= 1e5, "must be above 0"),
            ("wait_limit_s", self.wait_limit_s >= 60.0, "must be 60 s or more"),
            ("stale_s", self.stale_s >= 0.0, "must be 0 (off) or more"),
            ("serial_node", nodes.parse(self.serial_node) is not None, "is no node path of this control"),
            ("version_node", nodes.parse(self.version_node) is not None, "is no node path of this control"),
        )

    @property
    def secured(self) -> bool:
        """Whether messages are signed and encrypted."""
        return self.security != NONE

    @property
    def policies(self) -> tuple[str, ...]:
        """Security policies that may be used, best first."""
        return POLICIES if self.security == BEST else (self.security,)

    def _one_password(self) -> bool:
        return sum(map(bool, (self.password, self.password_file, self.password_env))) <= 1

    def _free(self) -> bool:
        """Whether the set-up values have R parameters of their own."""
        first, count = self.words.setup, len(SetupWord)
        apart = first + count <= self.r_first or first >= self.r_first + COUNT
        return apart and 0 <= first <= nodes.R_LAST - 2 and self.r_setup >= -1

    @property
    def words(self) -> Words:
        """The R parameters of this site."""
        before = self.r_first - len(SetupWord)
        usual = before if before >= 0 else self.r_first + COUNT
        return Words(self.r_first, self.r_setup if self.r_setup >= 0 else usual)


@dataclass(frozen=True, slots=True)
class Secrets:
    """What a login needs, read from where the settings point: ``pinned`` and ``own`` are None without security.

    ``policies`` may be used, best first.
    """

    user: str
    password: str
    pinned: x509.Certificate | None = None
    own: KeyPair | None = None
    policies: tuple[str, ...] = POLICIES


def secrets_of(settings: UaSettings, where: str) -> Secrets:
    """Read password and certificates; blocking.

    Raises ConfigError (E-UA-SECRET, E-UA-SECRET-ENV, E-UA-UNPINNED) naming key, file and why.
    """
    password = settings.password
    if settings.password_env:
        password = os.environ.get(settings.password_env, "")
        if not password:
            raise ConfigError("E-UA-SECRET-ENV", where, name=shown(settings.password_env))
    if settings.password_file:
        content = _content("password_file", settings.password_file, where)
        password = content.decode("utf-8", errors="replace").strip("\r\n")
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
    return Secrets(user=settings.user, password=password, pinned=pinned, own=own, policies=settings.policies)


def client_folder(settings: UaSettings) -> Path:
    """Where this gateway's own certificate and key lie: beside the pinned one unless the settings name a folder."""
    beside = Path(settings.server_certificate).parent / "trueflank-client"
    return Path(settings.client_folder) if settings.client_folder else beside


def _content(key: str, path: str, where: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise ConfigError("E-UA-SECRET", where, key=key, path=path, why=str(error)) from error
