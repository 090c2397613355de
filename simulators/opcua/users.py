"""Users of the OPC UA server and what each may do (Access MyMachine /OPC UA 12/2017, p. 950)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

RIGHTS = frozenset(
    {
        *(
            f"{area}{act}"
            for area in ("State", "Frame", "Sea", "Tea", "Tool", "Drive", "Gud")
            for act in ("Read", "Write")
        ),
        *("FsRead", "FsWrite", "PlcRead", "PlcWrite", "AlarmRead", "RandomRead", "RandomWrite"),
        *("SinuReadAll", "SinuWriteAll", "ApWrite"),
    }
)
# Files and program selection are not contained in the two collective rights.
_NOT_COLLECTIVE = frozenset({"FsRead", "FsWrite", "ApWrite", "RandomRead", "RandomWrite"})


@dataclass(frozen=True, slots=True)
class Account:
    """One user: a password and rights. The anonymous account has none and may only look at the server."""

    name: str
    password: str = ""
    rights: frozenset[str] = frozenset()

    def may(self, right: str) -> bool:
        """Whether the account has a right, by itself or through a collective one."""
        if right.casefold() in {one.casefold() for one in self.rights}:
            return True
        if right in _NOT_COLLECTIVE:
            return False
        return ("SinuReadAll" if right.endswith("Read") else "SinuWriteAll") in self.rights


ANONYMOUS = Account("")
ADMINISTRATOR = Account("OpcUaClient", "OpcUaClient", frozenset({"SinuReadAll"}))
GATEWAY_RIGHTS = frozenset({"SinuReadAll", "StateWrite", "FsRead", "FsWrite", "ApWrite", "AlarmRead"})


def accounts_of(users: Mapping[str, Any]) -> dict[str, Account]:
    """Accounts from a cell file: name -> password, or name -> {password, rights}. Raises ValueError."""
    accounts = {ADMINISTRATOR.name: ADMINISTRATOR}
    for name, given in users.items():
        entry = {"password": given} if isinstance(given, str) else dict(given)
        rights = frozenset(entry.get("rights", GATEWAY_RIGHTS))
        known = {right.casefold() for right in RIGHTS}
        unknown = sorted(right for right in rights if right.casefold() not in known)
        if unknown:
            raise ValueError(f"user {name}: unknown rights {unknown}")
        accounts[name] = Account(name, str(entry.get("password", name)), rights)
    return accounts
