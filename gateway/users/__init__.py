"""People who sign in: accounts with hashed secrets, roles, sessions, limits on trying. The web's doors call it."""

from __future__ import annotations

from gateway.users.accounts import UserAccounts, first_token_path
from gateway.users.limits import Tries
from gateway.users.records import ROLES, Person, UserAccount, UserRole
from gateway.users.sessions import Session, Sessions

__all__ = [
    "ROLES",
    "Person",
    "Session",
    "Sessions",
    "Tries",
    "UserAccount",
    "UserAccounts",
    "UserRole",
    "first_token_path",
]
