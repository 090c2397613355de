"""The doctor of the OPC UA driver, from the control's name to the examination; trust in the server's certificate.

Nothing is changed in the control. A certificate is pinned only by a person who typed its thumbprint.
"""

from __future__ import annotations

import asyncio
import json
import os
import stat
from collections.abc import Mapping
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from drivers.checks import CertificateView, CheckLine, TrustView, Wanted, failed, fine, unknown, wrong
from drivers.clock import Clock
from drivers.errors import ConfigError, DeviceRefused, OtherCertificate, TrueflankError
from drivers.local.ownfiles import make_own_parents, open_own
from drivers.message import Message
from drivers.sinumerik.opcua.control_checks import (
    CLOCK_LIMIT_S,
    ControlCheckContext,
    check_reading_account,
    examine_control,
)
from drivers.sinumerik.opcua.machine import MachineReader
from drivers.sinumerik.opcua.session import certificates
from drivers.sinumerik.opcua.session.certificates import KeyPair, last_record, load_certificate, record_path
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.connection import (
    APPLICATION_URI,
    Offer,
    client_folder,
    expired_error,
    is_valid_at,
    no_policy_error,
    read_secrets,
    read_writing_secrets,
)
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.reach import host_and_port, reach

# Trust.


class UaTrust:
    """Trust of one site's server; settings as the controller's, the pinned file is ``server_certificate``."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._url = url
        self._clock = clock
        self._settings = UaSettings.read(settings, name)
        if not self._settings.secured:
            raise ConfigError("E-TRUST-NO-SECURITY", name, security=self._settings.security)

    async def show(self, timeout_s: float) -> TrustView:
        """What the server shows now beside what is pinned. Nothing changes.

        Raises TransportError (E-UA-CONNECT), DeadlineExceeded, DeviceRefused (E-UA-POLICY), RemoteProtocolError.
        """
        return await asyncio.to_thread(self._view, await self._shown(timeout_s))

    async def accept(self, thumbprint: str, who: str, timeout_s: float, reason: str = "") -> TrustView:
        """Pin the certificate that the server shows now, if it is the one whose thumbprint was typed.

        One that is not valid now needs a ``reason``, which is kept and told with every connection and report.
        The old one is kept beside it; who accepted which and when is added to a record in the same folder.
        Raises as `show`, DeviceRefused (E-TRUST-OTHER, E-UA-EXPIRED), ConfigError (E-UA-SECRET).
        """
        session = UaSession(self._url, self._clock, self.name)
        certificate = await self._shown(timeout_s, session)
        shown = certificate_view(certificate)
        if not shown.is_called(thumbprint):
            raise OtherCertificate("E-TRUST-OTHER", self.name, typed=thumbprint or "nothing", shown=shown.sha256)
        valid = is_valid_at(certificate, self._clock.utc())
        if not (valid or reason.strip()):
            raise expired_error(certificate, session.ahead_s, self.name)
        try:
            await asyncio.to_thread(self._pin, certificate, who, "" if valid else reason.strip())
        except OSError as error:
            key, path = "server_certificate", self._settings.server_certificate
            raise ConfigError("E-UA-SECRET", self.name, key=key, path=path, why=str(error)) from error
        return await asyncio.to_thread(self._view, certificate)

    async def _shown(self, timeout_s: float, session: UaSession | None = None) -> x509.Certificate:
        offer: Offer = await (session or UaSession(self._url, self._clock, self.name)).offer(timeout_s)
        if not offer.best(self._settings.policies) or offer.certificate is None:
            raise no_policy_error(offer, self._settings.policies, self.name)
        return offer.certificate

    def _view(self, shown: x509.Certificate) -> TrustView:
        place = Path(self._settings.server_certificate)
        folder = client_folder(self._settings)
        own = certificates.own_key_pair(folder, "trueflank", APPLICATION_URI, "localhost").certificate
        last = last_record(place)
        return TrustView(
            url=self._url,
            shown=certificate_view(shown),
            pinned=certificate_view(load_certificate(place.read_bytes())) if place.is_file() else None,
            place=str(place),
            own=certificate_view(load_certificate(own.read_bytes())),
            accepted_by=str(last.get("who", "")),
            accepted_utc=str(last.get("utc", "")),
            reason=str(last.get("reason", "")),
        )

    def _pin(self, certificate: x509.Certificate, who: str, reason: str) -> None:
        place = Path(self._settings.server_certificate)
        make_own_parents(place)
        before = certificate_view(load_certificate(place.read_bytes())).sha256 if place.is_file() else ""
        if before:
            place.replace(place.with_name(f"{place.name}.old-{before.replace(':', '')[:16]}"))
        fresh = place.with_name(f".{place.name}.new")
        _store(fresh, certificate.public_bytes(Encoding.DER), "wb")
        fresh.replace(place)
        record = {"utc": self._clock.utc().isoformat(timespec="seconds"), "who": who, "url": self._url}
        record |= {"accepted": certificate_view(certificate).sha256, "before": before}
        record |= {"reason": reason} if reason else {}
        _store(record_path(place), (json.dumps(record) + "\n").encode(), "ab")


def certificate_view(certificate: x509.Certificate) -> CertificateView:
    """A certificate as people compare it."""
    return CertificateView(
        subject=certificate.subject.rfc4514_string(),
        sha256=certificates.fingerprint(certificate),
        sha1=certificates.short_fingerprint(certificate),
        valid_from=certificate.not_valid_before_utc,
        valid_until=certificate.not_valid_after_utc,
    )


def _store(path: Path, content: bytes, mode: str) -> None:
    with open_own(path, mode) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


# Doctor.

DEFAULT_PORT = 4840
SOON = timedelta(days=60)


class UaDoctor:
    """Settings as the controller's; every question is a read, a browse, or a call that only tells."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._url = url
        self._clock = clock
        self._settings = UaSettings.first(settings, name)
        self._session = UaSession(url, clock, name)

    async def examine(self, wanted: Wanted, timeout_s: float) -> tuple[CheckLine, ...]:
        """Every line in the order of the road. Where the road ends, the last line says what could not be asked."""
        lines = await self._road(timeout_s)
        if lines[-1].outcome != "ok":
            return (*lines, unknown("W-DOC-NOT-REACHED", "rest"))
        lines += await self._trust(timeout_s)
        if self._settings.secured and not self._settings.server_certificate:
            return (*lines, unknown("W-DOC-NOT-REACHED", "rest"))
        lines += await self._login(timeout_s)
        if not self._session.is_open:
            return (*lines, unknown("W-DOC-NOT-REACHED", "rest"))
        reader = MachineReader(self._session, self._settings, self.name)
        reader.timeout_s = timeout_s
        try:
            lines += await examine_control(
                ControlCheckContext(
                    session=self._session,
                    reader=reader,
                    settings=self._settings,
                    wanted=wanted,
                    clock=self._clock,
                    timeout_s=timeout_s,
                    where=self.name,
                )
            )
            if (most := self._session.found_limit) is not None:
                lines.append(fine("W-DOC-REQUEST-SIZE", "variables", most=most))
        finally:
            await self._session.close()
        return tuple(lines)

    async def _road(self, timeout_s: float) -> list[CheckLine]:
        try:
            host, port = host_and_port(self._url, DEFAULT_PORT)
        except ValueError as error:
            return [wrong("E-DOC-NAME", "name", host=self._url, why=str(error))]
        return await reach(host, port, self._clock, timeout_s)

    # ---- before the login ----------------------------------------------------------------------------

    async def _trust(self, timeout_s: float) -> list[CheckLine]:
        try:
            offer = await self._session.offer(timeout_s)
        except TrueflankError as error:
            return [failed(error, "endpoint", "unknown")]
        lines = [fine("W-DOC-ENDPOINT", "endpoint", offered=", ".join(offer.security)), self._policy(offer)]
        lines += self._clocks()
        if self._settings.secured:
            lines += await asyncio.to_thread(self._certificates, offer, self._clock.utc())
        return lines

    def _clocks(self) -> list[CheckLine]:
        """By the first answer, before a login that may fail for it; equal clocks are told after the login."""
        ahead_s = self._session.ahead_s
        if ahead_s is None or abs(ahead_s) <= CLOCK_LIMIT_S:
            return []
        return [wrong("E-DOC-CLOCK", "clock", apart_s=round(ahead_s), limit_s=CLOCK_LIMIT_S)]

    def _policy(self, offer: Offer) -> CheckLine:
        if not self._settings.secured:
            return wrong("E-DOC-NO-SECURITY", "policy", security=self._settings.security)
        policy = offer.best(self._settings.policies)
        if not policy:
            return failed(no_policy_error(offer, self._settings.policies, self.name), "policy")
        return fine("W-DOC-POLICY", "policy", policy=policy)

    def _certificates(self, offer: Offer, now: datetime) -> list[CheckLine]:
        place = Path(self._settings.server_certificate)
        if offer.certificate is None:
            return [unknown("W-DOC-NO-CERTIFICATE", "certificate")]
        if not self._settings.server_certificate:
            shown = certificate_view(offer.certificate)
            return [wrong("E-DOC-NO-CERTIFICATE", "certificate", sha256=shown.sha256, sha1=shown.sha1)]
        if not place.is_file():
            return [wrong("E-UA-UNPINNED", "certificate", path=place)]
        try:
            pinned = load_certificate(place.read_bytes())
        except (OSError, ValueError) as error:
            given = {"key": "server_certificate", "path": place, "why": error}
            return [wrong("E-UA-SECRET", "certificate", **given)]
        shown = certificate_view(offer.certificate)
        if offer.certificate != pinned:
            return [wrong("E-UA-TRUST", "certificate", found=shown.sha256, pinned=certificate_view(pinned).sha256)]
        accepted = last_record(place)
        who = (
            Message.of("W-DOC-BY", who=accepted["who"], utc=str(accepted["utc"])[:19])
            if accepted
            else Message.of("W-DOC-BY-NOBODY")
        )
        line = fine(
            "W-DOC-CERTIFICATE", "certificate", thumbprint=shown.sha256, until=shown.valid_until.date(), who=who
        )
        judged = _valid(line, now, shown.valid_from, shown.valid_until)
        if accepted.get("reason"):
            told = fine("W-DOC-EXCUSED", "certificate", who=who, reason=accepted["reason"])
            return [line if judged.code == "E-DOC-EXPIRED" else judged, told]
        return [judged]

    # ---- the login ------------------------------------------------------------------------------------

    async def _login(self, timeout_s: float) -> list[CheckLine]:
        """Our own certificate, then the login; the session is open afterwards if all of it went well."""
        lines: list[CheckLine] = []
        try:
            secrets = await asyncio.to_thread(read_secrets, self._settings, self.name)
            if secrets.own is not None:
                lines += await asyncio.to_thread(_own, secrets.own, self._clock.utc())
            await self._session.open(secrets, timeout_s)
            lines.append(self._logged_in(self._settings.user))
            writing = await asyncio.to_thread(read_writing_secrets, self._settings, secrets, self.name)
            if writing is not None:
                lines += await check_reading_account(self._session, timeout_s)
                await self._session.open(writing, timeout_s)
                lines.append(self._logged_in(writing.user))
        except TrueflankError as error:
            return [*lines, failed(error, _part_of_login(error))]
        return lines

    def _logged_in(self, user: str) -> CheckLine:
        return fine("W-DOC-LOGIN", "login", user=user or "(anonymous)", policy=self._session.policy or "None")


def _own(pair: KeyPair, now: datetime) -> list[CheckLine]:
    own = certificate_view(load_certificate(pair.certificate.read_bytes()))
    line = fine("W-DOC-OWN", "own certificate", thumbprint=own.sha1, until=own.valid_until.date())
    lines = [_valid(line, now, own.valid_from, own.valid_until)]
    return [*lines, wrong("E-DOC-KEY-OPEN", "own certificate", path=pair.key)] if _is_open(pair) else lines


def _valid(line: CheckLine, now: datetime, since: datetime, until: datetime) -> CheckLine:
    """The line itself while the certificate holds for long enough."""
    if not since <= now <= until:
        given = {"since": since.isoformat(), "until": until.isoformat(), "now": now.isoformat(timespec="seconds")}
        return wrong("E-DOC-EXPIRED", line.check, **given)
    return line if until - now > SOON else wrong("E-DOC-EXPIRES", line.check, days=(until - now).days)


def _is_open(pair: KeyPair) -> bool:
    """Whether others may read the private key, where the system can tell."""
    return os.name == "posix" and bool(stat.S_IMODE(pair.key.stat().st_mode) & 0o077)


def _part_of_login(error: TrueflankError) -> str:
    if error.code == "E-UA-NAMESPACE":
        return "namespace"
    if isinstance(error, DeviceRefused) and error.code in ("E-UA-TRUST", "E-UA-POLICY", "E-UA-EXPIRED"):
        return "certificate"
    return "own certificate" if error.code in ("E-UA-TRUST-US", "E-UA-OWN-EXPIRED") else "login"
