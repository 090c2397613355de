"""TLS on a TCP wire: whom we trust, who we are, and what a refused handshake means in words."""

from __future__ import annotations

import ssl
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import ConfigError, TransportError, TrueflankError

_DATES = {9, 10}
"""OpenSSL X509_V_ERR_CERT_NOT_YET_VALID and _HAS_EXPIRED."""
_NAMES = {62, 64}
"""OpenSSL X509_V_ERR_HOSTNAME_MISMATCH and _IP_ADDRESS_MISMATCH."""
_NO_TLS = ("WRONG_VERSION_NUMBER", "HTTP_REQUEST", "PACKET_LENGTH_TOO_LONG", "RECORD_LAYER_FAILURE", "UNEXPECTED_EOF")


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """Certificates of one wire, as PEM files.

    ``trusted`` is the peer's own certificate, or with ``server_name`` that of the authority that signed one with this
    name. ``certificate`` and ``key`` are ours: both ends prove who they are.
    """

    trusted: Path
    certificate: Path
    key: Path
    server_name: str = ""

    def context(self, url: str) -> ssl.SSLContext:
        """What a connection of ours needs; blocking. Raises ConfigError (E-TLS-FILE) naming the file."""
        made = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        made.minimum_version = ssl.TLSVersion.TLSv1_2
        made.check_hostname = bool(self.server_name)
        made.verify_mode = ssl.CERT_REQUIRED
        made.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
        self.pinned(url)
        try:
            made.load_verify_locations(cafile=str(self.trusted))
        except (OSError, ValueError) as error:
            raise ConfigError("E-TLS-FILE", url, file=self.trusted, why=str(error)) from error
        try:
            made.load_cert_chain(str(self.certificate), str(self.key), password=_no_password)
        except (OSError, ValueError) as error:
            files = f"{self.certificate}, {self.key}"
            raise ConfigError("E-TLS-FILE", url, file=files, why=str(error)) from error
        return made

    def pinned(self, url: str) -> bytes:
        """The trusted certificate itself (DER). Raises ConfigError (E-TLS-FILE)."""
        try:
            return ssl.PEM_cert_to_DER_cert(self.trusted.read_text(encoding="ascii"))
        except (OSError, ValueError) as error:
            raise ConfigError("E-TLS-FILE", url, file=self.trusted, why=str(error)) from error


def _no_password() -> str:
    raise ValueError("the key is protected by a password; give one without")


def tls_error(error: OSError, url: str) -> TrueflankError:
    """What a failed handshake means, or an alert later: TLS 1.3 tells of our own certificate after it."""
    if isinstance(error, ssl.SSLCertVerificationError):
        dated, named = error.verify_code in _DATES, error.verify_code in _NAMES
        code = "E-TLS-DATE" if dated else "E-TLS-NAME" if named else "E-TLS-TRUST"
        return ConfigError(code, url, why=error.verify_message)
    if not isinstance(error, ssl.SSLError):
        return TransportError("E-TLS-NONE", url, why=str(error) or type(error).__name__)
    reason = error.reason or str(error)
    if "ALERT" in reason:
        return TransportError("E-TLS-REFUSED", url, why=reason.lower().replace("_", " "))
    return TransportError("E-TLS-NONE" if reason.startswith(_NO_TLS) else "E-LINK-CONNECT", url, why=reason)
