"""The table of exit codes is what the program does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from drivers import errors as outer
from drivers.errors import TrueflankError
from gateway import errors as inner
from gateway.stopping import INTERRUPTED, TERMINATED
from gateway.workflow.axes.short_capture import EXIT
from gateway.workflow.run.outcome import CANNOT_TELL, LIMIT_EXCEEDED, of_verdicts

REMEASURE = 20
PAGE = Path(__file__).parents[3] / "docs" / "exit-codes.md"
ROW = re.compile(r"^\| (\d+) \| .+? \|(?: (.*))? \|$", re.MULTILINE)


def table() -> dict[int, set[str]]:
    rows = ROW.findall(PAGE.read_text(encoding="utf-8"))
    return {int(code): set(re.findall(r"`(\w+)`", names)) for code, names in rows}


def test_every_exception_with_a_code_of_its_own_stands_in_the_table() -> None:
    kinds = [one for module in (outer, inner) for one in vars(module).values() if isinstance(one, type)]
    found = [kind for kind in kinds if issubclass(kind, TrueflankError) and "exit_code" in vars(kind)]
    assert len(found) > 12
    for kind in found:
        assert kind.__name__ in table()[kind.exit_code], kind


def test_every_other_code_stands_there_too() -> None:
    known = {
        "LIMIT_EXCEEDED": LIMIT_EXCEEDED,
        "REMEASURE": REMEASURE,
        "CANNOT_TELL": CANNOT_TELL,
        "INTERRUPTED": INTERRUPTED,
        "TERMINATED": TERMINATED,
    }
    assert set(EXIT.values()) == {0, REMEASURE, CANNOT_TELL}
    for name, code in known.items():
        assert table()[code] - {"InDoubt"} == {name}
    assert set(table()) == {*range(16), 20, 21, 130, 143}


@pytest.mark.parametrize(
    ("verdicts", "code"),
    [((), 0), (("pass",), 0), (("pass", "not decidable"), 21), (("not decidable", "fail", "pass"), 13)],
)
def test_a_limit_that_is_exceeded_is_not_zero(verdicts: tuple[str, ...], code: int) -> None:
    assert of_verdicts(verdicts) == code
