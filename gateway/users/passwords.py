"""Secrets as argon2 hashes: the one place that knows how; slow on purpose, so never on the event loop."""

from __future__ import annotations

import functools
import hashlib
import secrets

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from argon2.low_level import Type, hash_secret_raw


class Hasher:
    """Hashes and checks secrets; ``time_cost`` and ``memory_kib`` are argon2's own, small ones for tests only."""

    def __init__(self, time_cost: int = 3, memory_kib: int = 65536) -> None:
        self.cost = (time_cost, memory_kib)
        self._argon = PasswordHasher(time_cost=time_cost, memory_cost=memory_kib, parallelism=1)

    def hashed(self, secret: str) -> str:
        """A new hash of a secret."""
        return self._argon.hash(secret)

    def is_right(self, kept: str, given: str) -> bool:
        """Whether a secret is the one that was hashed; without a hash it takes as long and says no."""
        try:
            return self._argon.verify(kept or self._nobody, given) and bool(kept)
        except (VerificationError, InvalidHashError):
            return False

    @functools.cached_property
    def _nobody(self) -> str:
        return self.hashed(secrets.token_urlsafe(16))


def token_digest(token: str) -> str:
    """What is kept of a program's token: it is long and random, so its sha256 is enough."""
    return hashlib.sha256(token.encode("utf-8", "replace")).hexdigest()


def derived(secret: str, salt: bytes, cost: tuple[int, int]) -> bytes:
    """A key of 32 bytes from a secret; ``cost`` as in `Hasher`, so it is as slow as a sign-in."""
    passes, kib = cost
    return hash_secret_raw(secret.encode("utf-8"), salt, passes, kib, 1, 32, Type.ID)
