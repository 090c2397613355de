"""`python -m release.signing make|sign|check ...`: sums of a release that bear a signature (ed25519, RFC 8032).

`make KEY` makes a private key (PEM, for its owner alone) and KEY.pub, which is published once, apart from releases.
`sign KEY SUMS` writes SUMS.sig beside a file of sums; `check PUBLIC SUMS` ends with 1 where the signature is not of it.
To check without this program: `openssl pkeyutl -verify -pubin -inkey KEY.pub -rawin -in SUMS -sigfile SUMS.sig`.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

ENDING = ".sig"


def make(key: Path) -> None:
    """A new key beside its public half. Raises FileExistsError: a key is never overwritten."""
    made = Ed25519PrivateKey.generate()
    pem, plain = serialization.Encoding.PEM, serialization.NoEncryption()
    with open(key, "xb", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
        file.write(made.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain))
    public = made.public_key().public_bytes(pem, serialization.PublicFormat.SubjectPublicKeyInfo)
    key.with_name(f"{key.name}.pub").write_bytes(public)


def sign(key: Path, sums: Path) -> Path:
    """Sign a file of sums; the signature's path. Raises ValueError for a key that is none of these."""
    found = serialization.load_pem_private_key(key.read_bytes(), None)
    if not isinstance(found, Ed25519PrivateKey):
        raise ValueError(f"{key}: no ed25519 key")
    place = sums.with_name(sums.name + ENDING)
    place.write_bytes(found.sign(sums.read_bytes()))
    return place


def is_signed(public: Path, sums: Path) -> bool:
    """Whether the signature beside a file of sums is of it and of this key."""
    found = serialization.load_pem_public_key(public.read_bytes())
    place = sums.with_name(sums.name + ENDING)
    if not isinstance(found, Ed25519PublicKey) or not place.exists():
        return False
    try:
        found.verify(place.read_bytes(), sums.read_bytes())
    except InvalidSignature:
        return False
    return True


def main(arguments: list[str]) -> int:
    """Make, sign or check."""
    what, key = arguments[0], Path(arguments[1])
    if what == "make":
        make(key)
        return 0
    sums = Path(arguments[2])
    if what == "sign":
        print(f"signed: {sign(key, sums)}")
        return 0
    good = is_signed(key, sums)
    print(f"{sums}: {'signed by this key' if good else 'NOT signed by this key'}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
