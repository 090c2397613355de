"""Which server certificate is trusted: shown, and pinned by a person who typed its thumbprint, never otherwise."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from drivers.checks import CertificateView, TrustView
from drivers.clock import Clock
from drivers.errors import ConfigError, OtherCertificate
from drivers.local.ownfiles import made_parents, opened
from drivers.sinumerik.opcua.session import certificates
from drivers.sinumerik.opcua.session.certificates import last_record, load, record_of
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.login import Offer, holds, no_policy, out_of_time
from drivers.sinumerik.opcua.session.secrets import APPLICATION_URI, client_folder
from drivers.sinumerik.opcua.settings import UaSettings


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
        shown = view(certificate)
        if not shown.is_called(thumbprint):
            raise OtherCertificate("E-TRUST-OTHER", self.name, typed=thumbprint or "nothing", shown=shown.sha256)
        valid = holds(certificate, self._clock.utc())
        if not (valid or reason.strip()):
            raise out_of_time(certificate, session.ahead_s, self.name)
        try:
            await asyncio.to_thread(self._pin, certificate, who, "" if valid else reason.strip())
        except OSError as error:
            key, path = "server_certificate", self._settings.server_certificate
            raise ConfigError("E-UA-SECRET", self.name, key=key, path=path, why=str(error)) from error
        return await asyncio.to_thread(self._view, certificate)

    async def _shown(self, timeout_s: float, session: UaSession | None = None) -> x509.Certificate:
        offer: Offer = await (session or UaSession(self._url, self._clock, self.name)).offer(timeout_s)
        if not offer.best(self._settings.policies) or offer.certificate is None:
            raise no_policy(offer, self._settings.policies, self.name)
        return offer.certificate

    def _view(self, shown: x509.Certificate) -> TrustView:
        place = Path(self._settings.server_certificate)
        folder = client_folder(self._settings)
        own = certificates.own_key_pair(folder, "trueflank", APPLICATION_URI, "localhost").certificate
        last = last_record(place)
        return TrustView(
            url=self._url,
            shown=view(shown),
            pinned=view(load(place.read_bytes())) if place.is_file() else None,
            place=str(place),
            own=view(load(own.read_bytes())),
            accepted_by=str(last.get("who", "")),
            accepted_utc=str(last.get("utc", "")),
            reason=str(last.get("reason", "")),
        )

    def _pin(self, certificate: x509.Certificate, who: str, reason: str) -> None:
        place = Path(self._settings.server_certificate)
        made_parents(place)
        before = view(load(place.read_bytes())).sha256 if place.is_file() else ""
        if before:
            place.replace(place.with_name(f"{place.name}.old-{before.replace(':', '')[:16]}"))
        fresh = place.with_name(f".{place.name}.new")
        _store(fresh, certificate.public_bytes(Encoding.DER), "wb")
        fresh.replace(place)
        record = {"utc": self._clock.utc().isoformat(timespec="seconds"), "who": who, "url": self._url}
        record |= {"accepted": view(certificate).sha256, "before": before}
        record |= {"reason": reason} if reason else {}
        _store(record_of(place), (json.dumps(record) + "\n").encode(), "ab")


def view(certificate: x509.Certificate) -> CertificateView:
    """A certificate as people compare it."""
    return CertificateView(
        subject=certificate.subject.rfc4514_string(),
        sha256=certificates.fingerprint(certificate),
        sha1=certificates.short_fingerprint(certificate),
        valid_from=certificate.not_valid_before_utc,
        valid_until=certificate.not_valid_after_utc,
    )


def _store(path: Path, content: bytes, mode: str) -> None:
    with opened(path, mode) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
