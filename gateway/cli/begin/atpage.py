"""The questions of `init` on the page of a service that has no site file yet: a `gateway.web.ports.SiteMaking`.

The page sends every answer so far, and the questions are gone through again up to the first open one: so an answer can
be changed, and what is asked next follows from it. What the control told meanwhile is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

from drivers.errors import TrueflankError
from gateway.cli.begin.checking import checked
from gateway.cli.begin.initialising import keep
from gateway.cli.begin.keys import PASSWORD
from gateway.cli.begin.questions import Judge, Why, anything
from gateway.cli.begin.wizard import STORE, wizard_text
from gateway.cli.stopping import run_to_end
from gateway.errors import InvalidOption

T = TypeVar("T")
Known = dict[tuple[object, ...], Any]


class _Open(Exception):
    """A question that has no answer yet, or one that will not do."""

    def __init__(self, question: dict[str, Any]) -> None:
        super().__init__(question["key"])
        self.question = question


class _Asking:
    """One way through the questions."""

    def __init__(self, answers: Mapping[str, str], known: Known, who: str) -> None:
        self.who = who
        self.asked: list[dict[str, Any]] = []
        self.told: list[dict[str, Any]] = []
        self._answers = answers
        self._known = known

    def ask(
        self, key: str, code: str, default: str, judge: Judge = anything, *, secret: bool = False, **fields: str
    ) -> str:
        """The answer that was sent; what is open ends this way."""
        answer = self._answers.get(key)
        why = None if answer is None else judge(answer)
        shown = "" if secret else answer or ""
        question = {"key": key, "code": code, "fields": fields, "secret": secret, "answer": shown}
        if answer is None or why is not None:
            raise _Open({**question, "default": default, "wrong": _as_data(why)})
        self.asked.append(question)
        return answer

    def tell(self, code: str, *, loud: bool = False, **fields: object) -> None:
        """Shown above the next question."""
        said = {"code": code, "fields": {key: str(value) for key, value in fields.items()}, "loud": loud}
        self.told.append({**said, "after": len(self.asked)})

    def found(self, what: tuple[object, ...], work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Asked once, until an earlier answer changes."""
        if what not in self._known:
            try:
                self._known[what] = run_to_end(work())
            except TrueflankError as error:
                self._known[what] = error
        kept = self._known[what]
        if isinstance(kept, TrueflankError):
            raise kept
        result: T = kept
        return result


def _as_data(why: Why | None) -> dict[str, Any] | None:
    return None if why is None else {"code": why.code, "fields": {key: str(one) for key, one in why.fields.items()}}


class SiteMaker:
    """Makes one site file by the answers of a page; nothing is overwritten."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.root = file.parent / STORE
        self._own_password = not (file.parent / PASSWORD).exists()
        self._known: Known = {}
        self._last: dict[str, str] = {}
        self._lock = Lock()

    def ask(self, answers: Mapping[str, str], who: str, *, anew: bool = False) -> dict[str, Any]:
        """The next question with what was found so far; no question where every one is answered.

        ``anew`` asks the control again. Blocks while the control is asked. Raises StoreError, ConfigError.
        """
        with self._lock:
            asking, question, _text = self._gone_through(answers, who, anew=anew)
        return {"file": str(self.file), "asked": asking.asked, "told": asking.told, "question": question}

    def write(self, answers: Mapping[str, str], who: str) -> dict[str, Any]:
        """Write the file; one that no site can be read from is taken back. Its faults, doubts and remarks are told.

        Raises ConfigError (E-INIT-ENDED, E-INIT-EXISTS, E-INIT-WRITE).
        """
        with self._lock:
            _asking, question, text = self._gone_through(answers, who, anew=False)
            if question is not None:
                raise InvalidOption("E-INIT-ENDED", "init", key=question["key"])
            keep(self.file, text)
            found = checked(self.file)
            if found.site is None:
                self.file.unlink()
        faults = [one.error(str(self.file)).as_record() for one in (*found.faults, *found.doubts)]
        told = {"faults": faults, "remarks": [one.as_data() for one in found.remarks]}
        return {"file": str(self.file), "made": found.site is not None, **told}

    def _gone_through(
        self, answers: Mapping[str, str], who: str, *, anew: bool
    ) -> tuple[_Asking, dict[str, Any] | None, str]:
        if anew or any(answers.get(key) != answer for key, answer in self._last.items()):
            self._known.clear()
        self._last = dict(answers)
        if self._own_password:  # asked again each time, so that another one can be given
            with suppress(FileNotFoundError):
                (self.file.parent / PASSWORD).unlink()
        asking = _Asking(answers, self._known, who)
        try:
            return asking, None, wizard_text(self.file, asking)
        except _Open as still:
            return asking, still.question, ""
