"""Signatures of approvals and proposals: who may write the store alone can add neither.

Each approver has an ed25519 key (RFC 8032). Its private half is kept in the account, sealed by AES-256-GCM under a key
that argon2id makes of the person's password or PIN; so nobody but who knows the secret can sign, an administrator
neither. This computer's own account has one more key, for proposals and for the file of accounts.

What is trusted stands in a folder outside every store (`keys_folder`), for its owner alone: the public keys of gateways
and, for each store, the people of its accounts with their keys and their names at operating systems. Who can write the
store but not that folder cannot make a key count. Two accounts of a computer that share a store share that folder too.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cryptography.exceptions import InvalidSignature, InvalidTag
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from drivers.local.names import person_key, stem
from drivers.local.ownfiles import make_own_folder, open_own, read_own
from gateway.errors import CorruptRecord
from gateway.store import disk_errors, write_whole
from gateway.users.passwords import derived

VARIABLE = "TRUEFLANK_KEYS"
KEY_BYTES, SALT_BYTES, NONCE_BYTES = 32, 16, 12


@dataclass(frozen=True, slots=True)
class Signer:
    """An unlocked key; ``public`` is its public half (hex)."""

    public: str
    _key: Ed25519PrivateKey = field(repr=False, compare=False)

    @classmethod
    def of(cls, raw: bytes) -> Signer:
        """The signer of a private key's 32 bytes."""
        key = Ed25519PrivateKey.from_private_bytes(raw)
        return cls(key.public_key().public_bytes_raw().hex(), key)

    @property
    def raw(self) -> bytes:
        """The private key's 32 bytes, to be sealed."""
        return self._key.private_bytes_raw()

    def signature_of(self, data: bytes) -> str:
        """The signature (hex)."""
        return self._key.sign(data).hex()


def is_signature(public: str, data: bytes, signature: str) -> bool:
    """Whether a signature of these bytes was made with the private half of a public key; false for what is neither."""
    try:
        Ed25519PublicKey.from_public_bytes(bytes.fromhex(public)).verify(bytes.fromhex(signature), data)
    except (ValueError, InvalidSignature):
        return False
    return True


@dataclass(frozen=True, slots=True)
class SealedKey:
    """An approver's key: its public half, and its private half sealed by each secret ("" for none)."""

    public: str
    by_password: str = ""
    by_pin: str = ""


def new_key() -> bytes:
    """A new private key's bytes."""
    return secrets.token_bytes(KEY_BYTES)


def seal(raw: bytes, secret: str, cost: tuple[int, int]) -> str:
    """A private key sealed under a secret; ``cost`` is argon2's (passes, KiB) and stands in the text."""
    salt, nonce = secrets.token_bytes(SALT_BYTES), secrets.token_bytes(NONCE_BYTES)
    sealed = AESGCM(derived(secret, salt, cost)).encrypt(nonce, raw, None)
    return f"{cost[0]}.{cost[1]}.{(salt + nonce + sealed).hex()}"


def unseal(sealed: str, secret: str) -> Signer | None:
    """Who signs with a sealed key; None where the secret is not the one that sealed it."""
    passes, kib, data = sealed.split(".")
    raw = bytes.fromhex(data)
    salt, nonce, rest = raw[:SALT_BYTES], raw[SALT_BYTES:][:NONCE_BYTES], raw[SALT_BYTES + NONCE_BYTES :]
    try:
        return Signer.of(AESGCM(derived(secret, salt, (int(passes), int(kib)))).decrypt(nonce, rest, None))
    except InvalidTag:
        return None


@dataclass(frozen=True, slots=True)
class KnownPerson:
    """A person of a store's accounts: the name, those at operating systems, the public key ("" for none)."""

    name: str
    system: tuple[str, ...] = ()
    key: str = ""


def keys_folder() -> Path:
    """The folder of keys: TRUEFLANK_KEYS, else one of this computer's account."""
    if named := os.environ.get(VARIABLE, ""):
        return Path(named)
    if os.name == "nt":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "trueflank" / "keys"
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "trueflank" / "keys"


class KeyRing:
    """What is trusted at one store, read afresh each time. Raises StoreError (E-STORE-DISK, E-USER-KEYS)."""

    def __init__(self, root: Path, user: str = "") -> None:
        """``user`` names the gateway's own key, where accounts of a computer share the folder."""
        self._folder = keys_folder()
        self._root = root.resolve()
        self._user = stem(user or _user(), unique=True)

    @property
    def path(self) -> Path:
        """The file of the people of this store."""
        return self._folder / f"people-{hashlib.sha256(str(self._root).encode()).hexdigest()[:16]}.json"

    @property
    def has_accounts(self) -> bool:
        """Whether the store's accounts were written here before: then an unsigned file of accounts is not ours."""
        return "people" in self._read()

    @property
    def accounts_root(self) -> Path:
        """The store whose accounts count here: this one, or that of the first site of its service."""
        return Path(str(self._read().get("follows", self._root)))

    def people(self) -> tuple[KnownPerson, ...]:
        """Who is known at this store."""
        ring = KeyRing(self.accounts_root)
        try:
            found = [
                KnownPerson(one["name"], tuple(one["system"]), one["key"]) for one in ring._read().get("people", ())
            ]
        except (TypeError, KeyError) as error:
            raise CorruptRecord("E-USER-KEYS", str(ring.path), why=str(error)) from error
        return tuple(found)

    def _read(self) -> dict[str, Any]:
        with disk_errors(self.path):
            data = read_own(self.path) if self.path.exists() else b"{}"
        try:
            told = json.loads(data)
        except ValueError as error:
            raise CorruptRecord("E-USER-KEYS", str(self.path), why=str(error)) from error
        if not isinstance(told, dict):
            raise CorruptRecord("E-USER-KEYS", str(self.path), why=type(told).__name__)
        return told

    def keep(self, people: Iterable[KnownPerson]) -> None:
        """From now on these people, and no others, are known at this store."""
        told = {"root": str(self._root), "people": [asdict(one) for one in people]}
        self._write(json.dumps(told, indent=1).encode("ascii"))

    def follow(self, root: Path) -> None:
        """The people of this store are those of another one: one service serves both."""
        if root.resolve() != self._root:
            self._write(json.dumps({"root": str(self._root), "follows": str(root.resolve())}, indent=1).encode("ascii"))

    def _write(self, data: bytes) -> None:
        with disk_errors(self._folder):
            make_own_folder(self._folder)
            if self.path.exists() and read_own(self.path) == data:
                return
        write_whole(self.path, data)

    @property
    def signs(self) -> bool:
        """Whether somebody here has a key: then an approval without a signature does not count."""
        return any(one.key for one in self.people())

    def person_named(self, name: str) -> str:
        """The one name of a person who is called so at the page or at an operating system; else the name itself."""
        wanted = person_key(name)
        for one in self.people():
            if wanted in map(person_key, (one.name, *one.system)):
                return one.name
        return name

    def is_persons(self, name: str, public: str, data: bytes, signature: str) -> bool:
        """Whether a person of this store signed these bytes with the key that is known."""
        keys = {one.key for one in self.people() if one.key and person_key(one.name) == person_key(name)}
        return public in keys and is_signature(public, data, signature)

    def gateway(self) -> Signer:
        """This account's own key, made at its first use."""
        place = self._folder / f"gateway-{self._user}.key"
        with disk_errors(place):
            make_own_folder(self._folder)
            try:
                with open_own(place, "xb", secret=True) as file:
                    file.write(new_key().hex().encode("ascii"))
                    file.flush()
                    os.fsync(file.fileno())
            except FileExistsError:
                pass
            text = read_own(place).decode("ascii", "replace").strip()
        try:
            signer = Signer.of(bytes.fromhex(text))
        except ValueError as error:
            raise CorruptRecord("E-USER-KEYS", str(place), why=str(error)) from error
        public = place.with_suffix(".pub")
        if not public.exists():
            write_whole(public, f"{signer.public}\n".encode("ascii"))
        return signer

    def is_gateways(self, public: str, data: bytes, signature: str) -> bool:
        """Whether a gateway that is trusted here signed these bytes."""
        with disk_errors(self._folder):
            known = {read_own(one).decode("ascii", "replace").strip() for one in self._folder.glob("gateway-*.pub")}
        return public in known and is_signature(public, data, signature)


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
