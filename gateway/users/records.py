"""Who may do what: a person as signed in, an account as kept; pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Literal, get_args

from drivers.local.names import person_key
from gateway.users.signatures import SealedKey, Signer

UserRole = Literal["viewer", "operator", "approver", "service"]
ROLES: tuple[UserRole, ...] = get_args(UserRole)
FEWEST_LETTERS = 10
FEWEST_DIGITS = 6
KEPT_FOR = timedelta(days=7)
"""How long who made an account, or gave it a secret, counts as somebody who may know that secret."""
TOKEN_DAYS, MOST_TOKEN_DAYS, MOST_TOKENS = 90, 366, 20
"""How long a program's token holds unless told otherwise, at most, and how many an account has at most."""


@dataclass(frozen=True, slots=True)
class Person:
    """Who asks. ``by`` says how that was proved: "session", "token" (a program's) or "terminal" (this computer).

    ``signer`` is the person's key, where the secret that unlocks it was given.
    """

    name: str
    roles: frozenset[UserRole]
    by: str = "session"
    signer: Signer | None = field(default=None, compare=False, repr=False)

    def may(self, role: UserRole) -> bool:
        """Whether this person has a role; who has any may look."""
        return role in self.roles or (role == "viewer" and bool(self.roles))


@dataclass(frozen=True, slots=True)
class ProgramToken:
    """A program's token: its sha256, and when it was made, ends and was used last (ISO 8601, UTC; "" for never)."""

    id: str
    digest: str
    made_utc: str = ""
    ends_utc: str = ""
    used_utc: str = ""

    def holds_at(self, utc: datetime) -> bool:
        """Whether it has not ended by a moment."""
        return not self.ends_utc or utc < datetime.fromisoformat(self.ends_utc)


@dataclass(frozen=True, slots=True)
class UserAccount:
    """A user as kept: secrets as argon2 hashes ("" for none).

    ``tokens`` are those of programs that act as this user; ``keepers`` who made the account or gave it a secret or a
    token, each with the moment (ISO 8601, UTC). ``system`` are the names of the same person at operating systems.
    ``factor`` is the secret of the second factor (base32, "" for none) and ``factor_step`` the last step that a code
    was taken of: no code counts twice. ``key`` signs the approvals.
    """

    name: str
    roles: tuple[UserRole, ...]
    password: str
    pin: str = ""
    tokens: tuple[ProgramToken, ...] = ()
    keepers: tuple[tuple[str, str], ...] = ()
    system: tuple[str, ...] = ()
    factor: str = ""
    factor_step: int = 0
    key: SealedKey | None = None

    @property
    def keys(self) -> frozenset[str]:
        """What every spelling of this person's names has in common: page and operating systems."""
        return frozenset(map(person_key, (self.name, *self.system)))

    def kept_by(self, utc: datetime) -> tuple[str, ...]:
        """Who made this account or gave it a secret within the seven days before a moment."""
        return tuple(dict.fromkeys(who for who, when in self.keepers if utc - datetime.fromisoformat(when) < KEPT_FOR))

    def kept_again(self, who: str, utc: datetime) -> tuple[tuple[str, str], ...]:
        """The keepers with one more; those of long ago are left out."""
        since = [one for one in self.keepers if utc - datetime.fromisoformat(one[1]) < KEPT_FOR]
        fresh = [one for one in since if person_key(one[0]) != person_key(who)]
        return (*fresh, (who, utc.isoformat(timespec="seconds")))

    def person(self, by: str = "session", signer: Signer | None = None) -> Person:
        """The person of this account."""
        return Person(self.name, frozenset(self.roles), by, signer)
