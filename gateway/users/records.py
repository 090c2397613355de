"""Who may do what: a person as signed in, an account as kept; pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

UserRole = Literal["viewer", "operator", "approver", "service"]
ROLES: tuple[UserRole, ...] = get_args(UserRole)
FEWEST_LETTERS = 10
FEWEST_DIGITS = 6


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
    """A user as kept: secrets as argon2 hashes ("" for none), a program's token as its sha256."""

    name: str
    roles: tuple[UserRole, ...]
    password: str
    pin: str = ""
    token: str = ""

    def person(self, by: str = "session") -> Person:
        """The person of this account."""
        return Person(self.name, frozenset(self.roles), by)
