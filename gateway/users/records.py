"""Who may do what: a person as signed in, an account as kept; pure."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Literal, get_args

UserRole = Literal["viewer", "operator", "approver", "service"]
ROLES: tuple[UserRole, ...] = get_args(UserRole)
FEWEST_LETTERS = 10
FEWEST_DIGITS = 6
KEPT_FOR = timedelta(days=7)
"""How long who made an account, or gave it a secret, counts as somebody who may know that secret."""


@dataclass(frozen=True, slots=True)
class Person:
    """Who asks. ``by`` says how that was proved: "session", "token" (a program's) or "terminal" (this computer)."""

    name: str
    roles: frozenset[UserRole]
    by: str = "session"

    def may(self, role: UserRole) -> bool:
        """Whether this person has a role; who has any may look."""
        return role in self.roles or (role == "viewer" and bool(self.roles))


@dataclass(frozen=True, slots=True)
class UserAccount:
    """A user as kept: secrets as argon2 hashes ("" for none), a program's token as its sha256.

    ``keepers`` are those who made the account or gave it a secret or a token, each with the moment (ISO 8601, UTC).
    """

    name: str
    roles: tuple[UserRole, ...]
    password: str
    pin: str = ""
    token: str = ""
    keepers: tuple[tuple[str, str], ...] = ()

    def kept_by(self, utc: datetime) -> tuple[str, ...]:
        """Who made this account or gave it a secret within the seven days before a moment."""
        return tuple(dict.fromkeys(who for who, when in self.keepers if utc - datetime.fromisoformat(when) < KEPT_FOR))

    def kept_again(self, who: str, utc: datetime) -> tuple[tuple[str, str], ...]:
        """The keepers with one more; those of long ago are left out."""
        fresh = [one for one in self.keepers if utc - datetime.fromisoformat(one[1]) < KEPT_FOR and one[0] != who]
        return (*fresh, (who, utc.isoformat(timespec="seconds")))

    def person(self, by: str = "session") -> Person:
        """The person of this account."""
        return Person(self.name, frozenset(self.roles), by)
