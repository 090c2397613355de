"""The accounts of a service: one private file in the state folder, and the token that lets the first one be made."""

from __future__ import annotations

import json
import os
import secrets
import threading
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from drivers.local.names import MOST, allowed, is_name, person_key, shown
from drivers.local.ownfiles import make_own_folder, open_own, read_own, sync_folder
from drivers.message import Message
from gateway.errors import (
    CodeAsked,
    CorruptRecord,
    InvalidAccount,
    LastAdministrator,
    NotSignedIn,
    RecordNotFound,
)
from gateway.store import disk_errors
from gateway.store import replace as moved
from gateway.users.leaked import is_leaked
from gateway.users.passwords import Hasher, token_digest
from gateway.users.records import (
    FEWEST_DIGITS,
    FEWEST_LETTERS,
    MOST_TOKEN_DAYS,
    MOST_TOKENS,
    ROLES,
    TOKEN_DAYS,
    Person,
    ProgramToken,
    UserAccount,
    UserRole,
)
from gateway.users.second_factor import is_factor, step_of
from gateway.users.signatures import KeyRing, KnownPerson, SealedKey, Signer, new_key, seal, unseal

FOLDER, USERS, FIRST = "service", "users.json", "first-start.token"
SCHEMA = 2
OLDER = "older"
"""The token that an account of schema 1 had."""


def first_token_path(root: Path) -> Path:
    """Where the token of the first start stands until the first account is made."""
    return root / FOLDER / FIRST


class UserAccounts:
    """All accounts below a state folder, read afresh each time: two processes may change them.

    ``leaked`` is a list of passwords that nobody may choose (`gateway.users.leaked`), None for none.
    """

    def __init__(self, root: Path, hasher: Hasher | None = None, leaked: Path | None = None) -> None:
        self._path = root / FOLDER / USERS
        self._first = first_token_path(root)
        self._hasher = hasher or Hasher()
        self.ring = KeyRing(root)
        self._leaked = leaked
        self._uses: dict[str, str] = {}
        self._changing = threading.RLock()

    def all(self) -> tuple[UserAccount, ...]:
        """Every account by name. Raises CorruptRecord (E-USER-FILE, E-USER-FOREIGN), StoreError (E-STORE-DISK)."""
        with disk_errors(self._path):
            data = read_own(self._path) if self._path.exists() else b""
        if not data:
            self._require_ours("", b"", "")
            return ()
        try:
            kept = json.loads(data)
            self._require_ours(kept.get("key", ""), _signed(kept["users"]), kept.get("signature", ""))
            return tuple(_account(one) for one in kept["users"])
        except (ValueError, TypeError, KeyError) as error:
            raise CorruptRecord("E-USER-FILE", str(self._path), why=str(error)) from error

    def _require_ours(self, public: str, data: bytes, signature: str) -> None:
        """Once this file was written here, one that is not signed by a gateway known here is somebody else's."""
        if (public or self.ring.has_accounts) and not self.ring.is_gateways(public, data, signature):
            raise CorruptRecord("E-USER-FOREIGN", str(self._path), keys=str(self.ring.path))

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
        system: Sequence[str] | None = None,
        forget_factor: bool = False,
        signer: Signer | None = None,
    ) -> UserAccount:
        """Make an account, or change one: what is left empty of a known one stays, its name as it was spelled.

        ``by`` is who does it and when: for seven days that person's pushes cannot be approved by this account.
        ``system`` are the person's names at operating systems (None: as they were). ``signer`` is the account's own
        key, where the person changes a secret; without it a new password gives an approver a new key, and a new PIN
        unlocks none.

        A new password ends the programs' tokens. The last account with the role service keeps it. Raises StoreError
        (E-USER-NAME, E-USER-ROLE, E-USER-PASSWORD, E-USER-LEAKED, E-USER-PIN, E-USER-SYSTEM, E-USER-LAST, E-USER-LIST,
        E-STORE-DISK).
        """
        _check(name, roles, password, pin, new=known is None)
        self._require_unknown(password)
        name = known.name if known else name
        new_password = self._hasher.hashed(password) if password else ""
        new_pin = self._hasher.hashed(pin) if pin else ""
        with self._changing:
            every = self.all()
            before = next((one for one in every if one.name == name), known) or UserAccount(name, (), "")
            account = replace(
                before,
                roles=tuple(sorted(set(roles))),
                password=new_password or before.password,
                pin=new_pin or before.pin,
                tokens=() if password else before.tokens,
                system=before.system if system is None else tuple(dict.fromkeys(one.strip() for one in system)),
                factor="" if forget_factor else before.factor,
                key=self._key_of(before, roles, password, pin, signer),
            )
            if by is not None and (known is None or password or pin or (forget_factor and before.factor)):
                account = replace(account, keepers=account.kept_again(*by))
            _check_system(account, every)
            self._keep(every, [one for one in every if one.name != name] + [account], name)
        self._forget_first()
        return account

    def remove(self, name: str) -> bool:
        """Take an account away; false where there is none. The last one with the role service stays.

        Raises StoreError (E-USER-LAST).
        """
        with self._changing:
            every, known = self.all(), self.find(name)
            if known is None:
                return False
            self._keep(every, [one for one in every if one.name != known.name], known.name)
        return True

    def _keep(self, every: Sequence[UserAccount], left: list[UserAccount], name: str) -> None:
        """One rule for whatever changes or takes away an account: somebody goes on managing accounts."""
        if _administered(every) and not _administered(left):
            raise LastAdministrator("E-USER-LAST", str(self._path), name=shown(name))
        self._write(left)

    def _key_of(
        self, before: UserAccount, roles: Iterable[UserRole], password: str, pin: str, signer: Signer | None
    ) -> SealedKey | None:
        """The key of an account with new secrets: nobody but who knows the old one can seal the old key anew."""
        known = before.key
        if "approver" not in roles:
            return None
        if not (password or pin):
            return known
        if signer is not None and known is not None and signer.public == known.public:
            by_password, by_pin = self._seals(signer, password, pin)
            return SealedKey(known.public, by_password or known.by_password, by_pin or known.by_pin)
        if password or known is None or not known.by_password:
            made = Signer.of(new_key())
            return SealedKey(made.public, *self._seals(made, password, pin))
        return replace(known, by_pin="")

    def _seals(self, signer: Signer, password: str, pin: str) -> tuple[str, str]:
        sealed = [seal(signer.raw, secret, self._hasher.cost) if secret else "" for secret in (password, pin)]
        return sealed[0], sealed[1]

    def change_secret(
        self, name: str, *, password: str = "", pin: str = "", signer: Signer | None = None
    ) -> UserAccount:
        """A person's own new password or PIN: nobody else has come to know it, and the key stays. Raises as `put`."""
        known = self._known(name)
        return self.put(known.name, known.roles, password=password, pin=pin, known=known, signer=signer)

    def _known(self, name: str) -> UserAccount:
        known = self.find(name)
        if known is None:
            raise RecordNotFound("E-USER-NONE", str(self._path), name=shown(name))
        return known

    def _change(self, account: UserAccount) -> UserAccount:
        self._write([account if one.name == account.name else one for one in self.all()])
        return account

    def give_token(self, name: str, utc: datetime, *, by: str = "", days: int = TOKEN_DAYS) -> tuple[str, ProgramToken]:
        """A new token for a program that acts as this account, shown once and kept as a hash, and what is kept.

        ``by`` is who made it (as in `put`); it ends after ``days``. Tokens that have ended go.
        Raises StoreError (E-USER-NONE, E-USER-TOKEN-DAYS, E-USER-TOKENS, E-STORE-DISK).
        """
        if not 1 <= days <= MOST_TOKEN_DAYS:
            raise InvalidAccount("E-USER-TOKEN-DAYS", "users", days=days, most=MOST_TOKEN_DAYS)
        with self._changing:
            known = self._known(name)
            left = tuple(one for one in known.tokens if one.holds_at(utc))
            if len(left) >= MOST_TOKENS:
                raise InvalidAccount("E-USER-TOKENS", "users", name=shown(known.name), most=MOST_TOKENS)
            token = secrets.token_urlsafe(32)
            since, until = (one.isoformat(timespec="seconds") for one in (utc, utc + timedelta(days=days)))
            made = ProgramToken(secrets.token_hex(4), token_digest(token), since, until)
            keepers = known.kept_again(by, utc) if by else known.keepers
            self._change(replace(known, tokens=(*left, made), keepers=keepers))
        return token, made

    def end_token(self, name: str, token_id: str) -> bool:
        """End a program's token; false where there is none of this id. Raises StoreError (E-USER-NONE)."""
        with self._changing:
            known = self._known(name)
            left = tuple(one for one in known.tokens if one.id != token_id)
            if len(left) == len(known.tokens):
                return False
            self._change(replace(known, tokens=left))
        return True

    def by_secret(self, name: str, *, password: str = "", pin: str = "") -> Person:
        """Who signs in with a password or a PIN; slow on purpose. Raises SignInRefused (E-USER-SECRET).

        An approver's key is unlocked by it; who has none yet, as in an older version, gets one.
        """
        known = self.find(name) or UserAccount(name, (), "")
        by_pin = bool(pin and not password)
        kept, given = (known.pin, pin) if by_pin else (known.password, password)
        if not self._hasher.is_right(kept, given):
            raise NotSignedIn("E-USER-SECRET", "sign-in")
        if "approver" not in known.roles:
            return known.person()
        if known.key is None:
            made = Signer.of(new_key())
            seals = self._seals(made, "" if by_pin else given, given if by_pin else "")
            with self._changing:
                self._change(replace(self._known(name), key=SealedKey(made.public, *seals)))
            return known.person(signer=made)
        sealed = known.key.by_pin if by_pin else known.key.by_password
        return known.person(signer=unseal(sealed, given) if sealed else None)

    def take_code(self, name: str, code: str, utc: datetime) -> None:
        """Where an account has a second factor, use up a code of it. Raises SignInRefused (E-USER-CODE)."""
        with self._changing:
            known = self.find(name)
            if known is None or not known.factor:
                return
            step = step_of(known.factor, code, utc, known.factor_step)
            if not step:
                raise CodeAsked("E-USER-CODE", "sign-in")
            self._change(replace(known, factor_step=step))

    def set_factor(self, name: str, secret: str, code: str, utc: datetime) -> None:
        """Give an account the second factor that this code is of. Raises StoreError (E-USER-FACTOR)."""
        step = step_of(secret, code, utc) if is_factor(secret) else 0
        if not step:
            raise InvalidAccount("E-USER-FACTOR", "users")
        with self._changing:
            self._change(replace(self._known(name), factor=secret, factor_step=step))

    def forget_factor(self, name: str) -> None:
        """Take an account's second factor away. Raises StoreError (E-USER-NONE)."""
        with self._changing:
            self._change(replace(self._known(name), factor="", factor_step=0))

    def by_token(self, token: str, utc: datetime) -> Person | None:
        """Whose program bears this token now; None where nobody's, or where it has ended."""
        digest = token_digest(token)
        for account in self.all():
            for one in account.tokens:
                if secrets.compare_digest(one.digest, digest) and one.holds_at(utc):
                    self._uses[digest] = utc.isoformat(timespec="seconds")
                    return account.person("token")
        return None

    def tokens_of(self, account: UserAccount) -> tuple[ProgramToken, ...]:
        """The tokens of an account with their last use, this process's own among them."""
        return tuple(replace(one, used_utc=self._uses.get(one.digest, one.used_utc)) for one in account.tokens)

    def keep_uses(self) -> None:
        """Write when tokens were used last; not at each use, for that is in the way of what they are used for."""
        with self._changing:
            every = self.all()
            told = [replace(one, tokens=self.tokens_of(one)) for one in every]
            if told != list(every):
                self._write(told)

    def migrate(self, utc: datetime) -> tuple[Message, ...]:
        """Bring accounts of an older version to today's rules; what was done, for people.

        Of accounts whose names are one name in another spelling the first by name stays; each other one gets a number
        behind its name and loses the role approver, for it may be the same person's. Tokens without an end get one.
        """
        with self._changing:
            every = self.all()
            named, told = _one_name_each(every)
            until = (utc + timedelta(days=TOKEN_DAYS)).isoformat(timespec="seconds")
            ended = [replace(one, tokens=tuple(_with_end(each, until) for each in one.tokens)) for one in named]
            if ended != list(every) or (every and not self.ring.has_accounts):
                self._write(ended)
            elif every:
                self.ring.keep(map(_known_person, every))
        return told

    def _require_unknown(self, password: str) -> None:
        if password and self._leaked is not None and is_leaked(password, self._leaked):
            raise InvalidAccount("E-USER-LEAKED", "users")

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
        signer = self.ring.gateway()
        told = {
            "schema": SCHEMA,
            "users": users,
            "key": signer.public,
            "signature": signer.signature_of(_signed(users)),
        }
        data = json.dumps(told, indent=1).encode("ascii")
        temporary = self._path.with_name(f".{USERS}.{secrets.token_hex(4)}.tmp")
        with disk_errors(self._path):
            make_own_folder(self._path.parent)
            try:
                _written(temporary, data)
                moved(temporary, self._path)
            finally:
                temporary.unlink(missing_ok=True)
            sync_folder(self._path.parent)
        # A crash before this leaves a signed file, whose people the next start makes known.
        self.ring.keep(map(_known_person, accounts))


def _signed(users: object) -> bytes:
    """What of the file is signed."""
    return b"trueflank accounts 1\n" + json.dumps(users, sort_keys=True).encode("ascii")


def _known_person(account: UserAccount) -> KnownPerson:
    return KnownPerson(account.name, account.system, account.key.public if account.key is not None else "")


def _account(kept: dict[str, Any]) -> UserAccount:
    fields = dict(kept)
    older = str(fields.pop("token", ""))
    tokens = [ProgramToken(**one) for one in fields.get("tokens", ())]
    tokens += [ProgramToken(OLDER, older)] if older else []
    for moment in (one.ends_utc for one in tokens if one.ends_utc):
        datetime.fromisoformat(moment)
    keepers = tuple((str(who), datetime.fromisoformat(when).isoformat()) for who, when in fields.get("keepers", ()))
    fields["key"] = SealedKey(**fields["key"]) if fields.get("key") else None
    lists = {"roles": tuple(fields["roles"]), "system": tuple(fields.get("system", ()))}
    return UserAccount(**{**fields, **lists, "tokens": tuple(tokens), "keepers": keepers})


def _one_name_each(every: Iterable[UserAccount]) -> tuple[list[UserAccount], tuple[Message, ...]]:
    kept: dict[str, UserAccount] = {}
    doubles: list[UserAccount] = []
    for one in every:
        if kept.setdefault(person_key(one.name), one) is not one:
            doubles.append(one)
    told = []
    for one in doubles:
        numbers = (f"{one.name}-{number}" for number in range(2, len(doubles) + len(kept) + 3))
        free = next(name for name in numbers if person_key(name) not in kept)
        first = kept[person_key(one.name)]
        roles = tuple(role for role in one.roles if role != "approver") or ("viewer",)
        kept[person_key(free)] = replace(one, name=free, roles=roles)
        told.append(Message.of("W-USER-RENAMED", was=one.name, now=free, name=first.name))
    return list(kept.values()), tuple(told)


def _with_end(token: ProgramToken, until: str) -> ProgramToken:
    return token if token.ends_utc else replace(token, ends_utc=until)


def _check_system(account: UserAccount, every: Sequence[UserAccount]) -> None:
    """No name may mean two people: neither a name at an operating system nor a new account's."""
    for other in every:
        shared = account.keys & other.keys if person_key(other.name) != person_key(account.name) else frozenset()
        if shared:
            named = ", ".join(sorted(shared))
            raise InvalidAccount("E-USER-SYSTEM", "users", named=shown(named), name=shown(other.name))
    if any(not one or len(one) > MOST for one in account.system):
        raise InvalidAccount("E-USER-NAME", "users", name=shown(", ".join(account.system)), allowed=allowed())


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
