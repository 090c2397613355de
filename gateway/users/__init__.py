"""People who sign in: accounts with hashed secrets, roles, sessions, limits on trying. The web's doors call it."""

from __future__ import annotations

from gateway.users.accounts import UserAccounts, first_token_path
from gateway.users.browsers import KnownBrowsers
from gateway.users.limits import Tries
from gateway.users.records import ROLES, Person, UserAccount, UserRole
from gateway.users.refusals import RefusedSignIn, RefusedSignIns
from gateway.users.sessions import Session, Sessions

__all__ = [
    "ROLES",
    "KnownBrowsers",
    "Person",
    "RefusedSignIn",
    "RefusedSignIns",
    "Session",
    "Sessions",
    "Tries",
    "UserAccount",
    "UserAccounts",
    "UserRole",
    "first_token_path",
]
