"""X.509 for OPC UA: a self-signed application certificate, and fingerprints to pin a peer by."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from drivers.local.ownfiles import make_own_folder, open_own

YEARS = 10


@dataclass(frozen=True, slots=True)
class KeyPair:
    """Where a certificate (DER) and its private key (PEM, readable by its owner alone) lie."""

    certificate: Path
    key: Path


def own_key_pair(folder: Path, name: str, application_uri: str, host: str, *, server: bool = False) -> KeyPair:
    """The key pair of an application, made at first use. Raises OSError when the folder cannot be used."""
    pair = KeyPair(folder / f"{name}.der", folder / f"{name}.key.pem")
    if pair.certificate.is_file() and pair.key.is_file():
        return pair
    make_own_folder(folder)
    key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    _write_private(pair.key, _pem(key))
    certificate = _self_signed(key, name, application_uri, host, server=server)
    pair.certificate.write_bytes(certificate.public_bytes(serialization.Encoding.DER))
    return pair


@lru_cache(maxsize=8)
def load_private_key(content: bytes) -> Any:
    """The key in a PEM file of ours. Raises ValueError for anything else.

    Proving that the primes of a key are primes takes longer than all the rest of opening a server: once for each key.
    """
    return serialization.load_pem_private_key(content, None)


def load_certificate(content: bytes) -> x509.Certificate:
    """A certificate from DER or PEM. Raises ValueError for anything else."""
    if content.lstrip().startswith(b"-----BEGIN"):
        return x509.load_pem_x509_certificate(content)
    return x509.load_der_x509_certificate(content)


def fingerprint(certificate: x509.Certificate) -> str:
    """SHA-256 of the DER form, as pairs of hex digits."""
    return certificate.fingerprint(hashes.SHA256()).hex(":").upper()


def short_fingerprint(certificate: x509.Certificate) -> str:
    """SHA-1 of the DER form, which OPC UA calls the thumbprint (OPC 10000-4), as pairs of hex digits."""
    return certificate.fingerprint(hashes.SHA1()).hex(":").upper()  # noqa: S303 - for comparing by eye


def uri_of(pair: KeyPair | None) -> str:
    """The application's name (URI) in a certificate; "" without one. Never raises: it is only told."""
    if pair is None:
        return ""
    try:
        names = load_certificate(pair.certificate.read_bytes()).extensions.get_extension_for_class(
            x509.SubjectAlternativeName
        )
    except (OSError, ValueError, x509.ExtensionNotFound):
        return ""
    return next(iter(names.value.get_values_for_type(x509.UniformResourceIdentifier)), "")


def record_path(place: Path) -> Path:
    """Where it is written down who accepted what, one JSON object a line."""
    return place.with_name(f"{place.name}.accepted.jsonl")


def last_record(place: Path) -> dict[str, Any]:
    """Of the certificate pinned now; empty when it was put there by other means."""
    path = record_path(place)
    if not path.is_file() or not place.is_file():
        return {}
    pinned = fingerprint(load_certificate(place.read_bytes()))
    records = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    return next((record for record in reversed(records) if record.get("accepted") == pinned), {})


def acceptance_reason(place: Path) -> str:
    """Why a person accepted the pinned certificate although it was not valid then; "" where nobody did."""
    return str(last_record(place).get("reason", ""))


def _pem(key: rsa.RSAPrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _write_private(path: Path, content: bytes) -> None:
    with open_own(path, "wb", secret=True) as file:
        file.write(content)


def _self_signed(
    key: rsa.RSAPrivateKey, name: str, application_uri: str, host: str, *, server: bool
) -> x509.Certificate:
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    names = [x509.UniformResourceIdentifier(application_uri), x509.DNSName(host)]
    usage = ExtendedKeyUsageOID.SERVER_AUTH if server else ExtendedKeyUsageOID.CLIENT_AUTH
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=365 * YEARS))
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(), critical=True)
        .add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
    )
    return builder.sign(key, hashes.SHA256())


def _key_usage() -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        content_commitment=True,
        key_encipherment=True,
        data_encipherment=True,
        key_agreement=False,
        key_cert_sign=False,
        crl_sign=False,
        encipher_only=False,
        decipher_only=False,
    )
