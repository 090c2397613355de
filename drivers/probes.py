"""Questions to a control and what it answered: a recorded session that names nobody, and how two of them differ."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal, Protocol, cast, get_args

from drivers.errors import FileFormatError
from drivers.message import Message

Level = Literal["read", "program", "motion", "write"]
LEVELS: tuple[Level, ...] = get_args(Level)
FORMER_LEVELS = {"move": "program"}
"""Words of older sessions: their questions start programs, and none moves an axis."""
FORM = 1
LARGEST = 4 * 1024 * 1024
NOT_ASKED = "not asked: "
Argument = str | int | float | bool


def allows(given: Level, needed: Level) -> bool:
    """Whether a level covers what is needed: write holds motion, motion holds program, and program holds read."""
    return LEVELS.index(given) >= LEVELS.index(needed)


@dataclass(frozen=True, slots=True)
class Probe:
    """One question. ``act`` says how it is asked, ``ask`` holds its parts; `what` says in words what is asked.

    Names of the machine stand in braces as roles ({axis}, {table}, {points}), filled in when the question is asked, so
    that the same question goes to a control and to a double with other axes. ``allow`` is the least level: read
    asks, program has a person start programs that move nothing, write also offers values that a control must refuse.
    ``running``: it is asked while a program runs.
    """

    name: str
    allow: Level
    what: str
    act: str
    ask: tuple[Argument, ...]
    running: bool = False


@dataclass(frozen=True, slots=True)
class Answer:
    """What a control said to a probe, in one line; `NOT_ASKED` and why where it could not be asked."""

    probe: Probe
    said: str

    @property
    def asked(self) -> bool:
        """Whether the question was put at all."""
        return not self.said.startswith(NOT_ASKED)


@dataclass(frozen=True, slots=True)
class ProbedSession:
    """Questions and answers in order. ``about`` holds driver, version and date; no name, number or address."""

    about: Mapping[str, str]
    answers: tuple[Answer, ...]

    def said(self, name: str) -> str:
        """What was answered to a probe. Raises KeyError."""
        return {answer.probe.name: answer.said for answer in self.answers}[name]

    def as_text(self) -> str:
        """The session as a JSON file."""
        entries = [{**asdict(answer.probe), "said": answer.said} for answer in self.answers]
        return json.dumps({"trueflank_session": FORM, "about": dict(self.about), "answers": entries}, indent=1) + "\n"


@dataclass(frozen=True, slots=True)
class Disagreement:
    """One question on which control and double do not agree."""

    probe: Probe
    control: str
    double: str

    @property
    def line(self) -> str:
        """One line for a person."""
        return f"{self.probe.name}: control says {self.control} / double says {self.double} ({self.probe.what})"


class Prober(Protocol):
    """Asks a control; a driver has one by the role "prober"."""

    async def ask(self, probes: Sequence[Probe], told: ProbeTold, timeout_s: float, start_s: float) -> ProbedSession:
        """Ask these in order; raises what the wire raises. ``start_s`` bounds the wait for a person."""
        ...

    def probes(self, allow: Level) -> tuple[Probe, ...]:
        """The written list of questions within an allowance."""
        ...


class ProbeTold(Protocol):
    """Hears what a person at the machine is to do: a code of the catalogue with fields."""

    def __call__(self, code: str, /, **fields: object) -> None:
        """Tell; never raises."""
        ...


def differences(control: ProbedSession, double: ProbedSession) -> tuple[Disagreement, ...]:
    """Every question that both were asked and answered differently, in the order of the control's session."""
    other = {answer.probe.name: answer for answer in double.answers if answer.asked}
    return tuple(
        Disagreement(one.probe, one.said, other[one.probe.name].said)
        for one in control.answers
        if one.asked and one.probe.name in other and other[one.probe.name].said != one.said
    )


def read_session(path: Path) -> ProbedSession:
    """A recorded session. Raises FileFormatError (E-PROBE-FILE) with the entry and what is wrong with it."""
    try:
        if path.stat().st_size > LARGEST:
            raise _bad(path, 0, Message.of("W-FILE-FILE-LARGER", largest=LARGEST))
        tree = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise _bad(path, 0, str(error)) from error
    if not isinstance(tree, dict) or tree.get("trueflank_session") != FORM or not isinstance(tree.get("answers"), list):
        raise _bad(path, 0, Message.of("W-PROBES-FORM", form=FORM))
    about = tree.get("about")
    kept = {str(key): str(value) for key, value in about.items()} if isinstance(about, dict) else {}
    answers = tuple(_answer(path, place, entry) for place, entry in enumerate(tree["answers"], start=1))
    names = [answer.probe.name for answer in answers]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise _bad(path, names.index(twice) + 1, Message.of("W-PROBES-TWICE", twice=twice))
    return ProbedSession(kept, answers)


def _answer(path: Path, place: int, entry: Any) -> Answer:
    known = {one.name for one in fields(Probe)} | {"said"}
    if not isinstance(entry, dict) or set(entry) != known:
        raise _bad(path, place, Message.of("W-PROBES-KEYS", known=", ".join(sorted(known))))
    entry = {**entry, "allow": FORMER_LEVELS.get(str(entry["allow"]), entry["allow"])}
    texts = all(isinstance(entry[key], str) for key in ("name", "what", "act", "said"))
    ask = entry["ask"]
    if not texts or entry["allow"] not in LEVELS or not isinstance(entry["running"], bool):
        raise _bad(path, place, Message.of("W-PROBES-TYPE"))
    if not isinstance(ask, list) or not all(isinstance(one, str | int | float | bool) for one in ask):
        raise _bad(path, place, Message.of("W-PROBES-ASK"))
    allow = cast(Level, entry["allow"])
    given = {key: entry[key] for key in ("name", "what", "act", "running")}
    return Answer(Probe(**given, allow=allow, ask=tuple(ask)), entry["said"])


def _bad(path: Path, place: int, why: str | Message) -> FileFormatError:
    return FileFormatError("E-PROBE-FILE", str(path), line=place, why=why)
