"""What a run asks of the person at the machine, counted by what the operator's own hands did, each with its cause."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from gateway.audience import ASK

DONE_BY_HAND = ("mounted ", "clamped ", "took the part off")


@dataclass
class Presses:
    """NCK resets, and presses of NC START, by what the run had last asked for; what was mounted or clamped, in order.

    A press that confirms a mounting or a clamping is part of that, and counts in ``handled`` alone. ``extra_min`` is
    what the run said that further targets would take, twice where its axis is measured again at all of them; ``stops``
    are those that were read.
    """

    log: list[str] = field(default_factory=list)
    resets: list[str] = field(default_factory=list)
    starts: list[str] = field(default_factory=list)
    handled: list[str] = field(default_factory=list)
    extra_min: float = 0.0
    stops: int = 0
    _again: bool = False
    _seen: int = 0
    _cause: str = "nothing"

    def told(self, code: str, fields: Mapping[str, object]) -> None:
        """The run said something: what was pressed until now was for what it had asked before."""
        self.take()
        self.stops += code == "P-STOP"
        if code in ("P-SETUP", "P-MEASURE"):
            component = str(fields["component"])
            self._again = component[1:2] == component[2:3]  # the error of an axis along itself: EXX
        if code == "P-MORE-TARGETS":
            self.extra_min += float(str(fields["minutes"])) * (2.0 if self._again else 1.0)
        if code in ASK or code == "P-NC-READ":
            what = fields.get("program") or fields.get("part") or ""
            self._cause = " ".join(str(word) for word in (code, fields.get("axis", ""), what) if word)

    def take(self) -> None:
        """Sort what the operator has done since the last look."""
        for place in range(self._seen, len(self.log)):
            done, before = self.log[place], self.log[place - 1] if place else ""
            if done == "NCK RESET":
                self.resets.append(self._cause)
            elif done == "NC START" and not before.startswith(DONE_BY_HAND):
                self.starts.append(self._cause)
            elif done.startswith(("mounted ", "clamped ")):
                self.handled.append(done)
        self._seen = len(self.log)

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """Mountings, blanks, starts and restarts."""
        mounted, clamped = (sum(one.startswith(word) for one in self.handled) for word in ("mounted ", "clamped "))
        return mounted, clamped, len(self.starts), len(self.resets)

    def listed(self) -> str:
        """Every count with its causes, for people."""
        rows = [("NCK reset", self.resets), ("NC START", self.starts), ("mounted or clamped", self.handled)]
        return "\n".join(f"{name}: {len(what)}{_causes(what)}" for name, what in rows)


def by_kind(starts: Iterable[str]) -> Counter[str]:
    """How many presses each code asked for, those for a program of stops by what it is for (TFMORE, TFAGAIN...)."""
    return Counter(_kind(*cause.split()) for cause in starts)


def _kind(code: str, *rest: str) -> str:
    program = next((word[:-1] for word in rest if word.startswith("TF")), "")
    return f"{code} {program}" if code.startswith("P-START") else code


def _causes(what: Iterable[str]) -> str:
    return "".join(f"\n  {count:3} {cause}" for cause, count in sorted(Counter(what).items()))
