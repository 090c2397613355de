"""People who sign in: accounts with hashed secrets, roles, sessions, limits on trying. The web's doors call it."""

from __future__ import annotations

from gateway.users.accounts import UserAccounts, first_token_path
from gateway.users.browsers import KnownBrowsers
from gateway.users.limits import Tries
from gateway.users.records import (
    MOST_TOKEN_DAYS,
    ROLES,
    TOKEN_DAYS,
    Person,
    ProgramToken,
    UserAccount,
    UserRole,
)
from gateway.users.refusals import RefusedSignIn, RefusedSignIns
from gateway.users.second_factor import factor_uri, new_factor
from gateway.users.sessions import Session, Sessions
from gateway.users.signatures import KeyRing, Signer

__all__ = [
    "MOST_TOKEN_DAYS",
    "ROLES",
    "TOKEN_DAYS",
    "KeyRing",
    "KnownBrowsers",
    "Person",
    "ProgramToken",
    "RefusedSignIn",
    "RefusedSignIns",
    "Session",
    "Sessions",
    "Signer",
    "Tries",
    "UserAccount",
    "UserAccounts",
    "UserRole",
    "factor_uri",
    "first_token_path",
    "new_factor",
]
