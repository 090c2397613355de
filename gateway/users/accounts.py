"""The accounts of a service: one private file in the state folder, and the token that lets the first one be made."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Sequence
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from drivers.local.names import allowed, is_name, person_key, shown
from drivers.local.ownfiles import make_own_folder, open_own, read_own
from gateway.errors import (
    CorruptRecord,
    InvalidAccount,
    LastAdministrator,
    NotSignedIn,
    RecordNotFound,
)
from gateway.store.disk import disk_errors, sync_folder
from gateway.store.disk import replace as moved
from gateway.users.passwords import Hasher, token_digest
from gateway.users.records import FEWEST_DIGITS, FEWEST_LETTERS, ROLES, Person, UserAccount, UserRole

FOLDER, USERS, FIRST = "service", "users.json", "first-start.token"
SCHEMA = 1


def first_token_path(root: Path) -> Path:
    """Where the token of the first start stands until the first account is made."""
    return root / FOLDER / FIRST


class UserAccounts:
    """All accounts below a state folder, read afresh each time: two processes may change them."""

    def __init__(self, root: Path, hasher: Hasher | None = None) -> None:
        self._path = root / FOLDER / USERS
        self._first = first_token_path(root)
        self._hasher = hasher or Hasher()

    def all(self) -> tuple[UserAccount, ...]:
        """Every account by name. Raises CorruptRecord (E-USER-FILE), StoreError (E-STORE-DISK)."""
        with disk_errors(self._path):
            data = read_own(self._path) if self._path.exists() else b""
        if not data:
            return ()
        try:
            kept = json.loads(data)
            return tuple(_account(one) for one in kept["users"])
        except (ValueError, TypeError, KeyError) as error:
            raise CorruptRecord("E-USER-FILE", str(self._path), why=str(error)) from error

    def find(self, name: str) -> UserAccount | None:
        """An account by its name, however it is spelled; of accounts of an older version the one spelled so."""
        wanted = person_key(name)
        alike = [one for one in self.all() if person_key(one.name) == wanted]
        return alike[0] if len(alike) == 1 else next((one for one in alike if one.name == name), None)

    def put(
        self,
        name: str,
        roles: tuple[UserRole, ...],
        *,
        password: str = "",
        pin: str = "",
        known: UserAccount | None = None,
        by: tuple[str, datetime] | None = None,
    ) -> UserAccount:
        """Make an account, or change one: what is left empty of a known one stays, its name as it was spelled.

        ``by`` is who does it and when: for seven days that person's pushes cannot be approved by this account.

        A new password ends the program's token. The last account with the role service keeps it. Raises StoreError
        (E-USER-NAME, E-USER-ROLE, E-USER-PASSWORD, E-USER-PIN, E-USER-LAST, E-STORE-DISK).
        """
        _check(name, roles, password, pin, new=known is None)
        name = known.name if known else name
        account = UserAccount(
            name=name,
            roles=tuple(sorted(set(roles))),
            password=self._hasher.hashed(password) if password else known.password if known else "",
            pin=self._hasher.hashed(pin) if pin else known.pin if known else "",
            token=known.token if known and not password else "",
            keepers=known.keepers if known else (),
        )
        if by is not None and (known is None or password or pin):
            account = replace(account, keepers=account.kept_again(*by))
        every = self.all()
        left = [one for one in every if one.name != name] + [account]
        if _administered(every) and not _administered(left):
            raise LastAdministrator("E-USER-LAST", str(self._path), name=shown(name))
        self._write(left)
        self._forget_first()
        return account

    def remove(self, name: str) -> bool:
        """Take an account away; false where there is none. The last one with the role service stays.

        Raises StoreError (E-USER-LAST).
        """
        known = self.find(name)
        if known is None:
            return False
        left = [one for one in self.all() if one.name != known.name]
        if not _administered(left):
            raise LastAdministrator("E-USER-LAST", str(self._path), name=shown(name))
        self._write(left)
        return True

    def give_token(self, name: str, by: tuple[str, datetime] | None = None) -> str:
        """A new token for a program that acts as this account, shown once and kept as a hash; ``by`` as in `put`.

        Raises StoreError (E-USER-NONE, E-STORE-DISK).
        """
        known = self.find(name)
        if known is None:
            raise RecordNotFound("E-USER-NONE", str(self._path), name=shown(name))
        token = secrets.token_urlsafe(32)
        digest = token_digest(token)
        given = replace(known, token=digest, keepers=known.kept_again(*by) if by else known.keepers)
        self._write([given if one.name == known.name else one for one in self.all()])
        return token

    def by_secret(self, name: str, *, password: str = "", pin: str = "") -> Person:
        """Who signs in with a password or a PIN; slow on purpose. Raises SignInRefused (E-USER-SECRET)."""
        known = self.find(name) or UserAccount(name, (), "")
        kept, given = (known.pin, pin) if pin and not password else (known.password, password)
        if not self._hasher.is_right(kept, given):
            raise NotSignedIn("E-USER-SECRET", "sign-in")
        return known.person()

    def by_token(self, token: str) -> Person | None:
        """Whose program bears this token; None where nobody's."""
        digest = token_digest(token)
        found = (one for one in self.all() if one.token and secrets.compare_digest(one.token, digest))
        return next((one.person("token") for one in found), None)

    @property
    def waits_for_first(self) -> bool:
        """Whether a token of the first start waits to be used: there is no account yet."""
        return self._first.exists()

    def first_token(self) -> str:
        """The token of the first start, made where there is no account yet; "" where there is one."""
        if self.all():
            self._forget_first()
            return ""
        with disk_errors(self._first):
            if self._first.exists():
                return read_own(self._first).decode("ascii", "replace").strip()
            token = secrets.token_urlsafe(24)
            make_own_folder(self._first.parent)
            _written(self._first, f"{token}\n".encode("ascii"))
        return token

    def _forget_first(self) -> None:
        with disk_errors(self._first):
            self._first.unlink(missing_ok=True)

    def _write(self, accounts: list[UserAccount]) -> None:
        users: list[dict[str, Any]] = [asdict(one) for one in sorted(accounts, key=lambda one: one.name)]
        data = json.dumps({"schema": SCHEMA, "users": users}, indent=1).encode("ascii")
        temporary = self._path.with_name(f".{USERS}.{secrets.token_hex(4)}.tmp")
        with disk_errors(self._path):
            make_own_folder(self._path.parent)
            try:
                _written(temporary, data)
                moved(temporary, self._path)
            finally:
                temporary.unlink(missing_ok=True)
            sync_folder(self._path.parent)


def _account(kept: dict[str, Any]) -> UserAccount:
    keepers = tuple((str(who), datetime.fromisoformat(when).isoformat()) for who, when in kept.get("keepers", ()))
    return UserAccount(**{**kept, "roles": tuple(kept["roles"]), "keepers": keepers})


def _administered(accounts: Sequence[UserAccount]) -> bool:
    """Whether somebody may keep the accounts."""
    return any("service" in one.roles for one in accounts)


def _written(path: Path, data: bytes) -> None:
    with open_own(path, "xb", secret=True) as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _check(name: str, roles: tuple[UserRole, ...], password: str, pin: str, *, new: bool) -> None:
    if not is_name(name):
        raise InvalidAccount("E-USER-NAME", "users", name=shown(name), allowed=allowed())
    if not roles or any(role not in ROLES for role in roles):
        raise InvalidAccount("E-USER-ROLE", "users", roles=shown(", ".join(roles)), known=", ".join(ROLES))
    if (new or password) and len(password) < FEWEST_LETTERS:
        raise InvalidAccount("E-USER-PASSWORD", "users", fewest=FEWEST_LETTERS)
    if pin and not (pin.isascii() and pin.isdigit() and FEWEST_DIGITS <= len(pin) <= 12):
        raise InvalidAccount("E-USER-PIN", "users", fewest=FEWEST_DIGITS)
