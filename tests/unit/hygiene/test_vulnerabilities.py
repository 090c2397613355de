"""`make vulnerabilities`: what was not asked is no answer, and what is known ends it, whoever was asked."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from release import vulnerabilities

Asked = tuple[int, int, list[str]]
ARGUMENTS = [".tools", "requirements.lock"]


def answering(monkeypatch: pytest.MonkeyPatch, answer: Callable[[str], Asked]) -> list[str]:
    """Data bases that answer so; who was asked."""
    services: list[str] = []

    def asked(_tools: object, _lock: object, service: str) -> Asked:
        services.append(service)
        return answer(service)

    monkeypatch.setattr(vulnerabilities, "asked", asked)
    return services


@pytest.mark.parametrize(("said", "code"), [(None, 1), ("", 1), ("offline", 0), ("yes", 1)])
def test_without_a_data_base_it_fails_unless_asked_not_to(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], said: str | None, code: int
) -> None:
    if said is None:
        monkeypatch.delenv("TRUEFLANK_VULNERABILITIES", raising=False)
    else:
        monkeypatch.setenv("TRUEFLANK_VULNERABILITIES", said)
    services = answering(monkeypatch, lambda _service: (0, 0, []))
    assert vulnerabilities.main(ARGUMENTS) == code
    assert "NOT CHECKED" in capsys.readouterr().out
    assert services == ["osv", "pypi"]


@pytest.mark.parametrize(
    ("answer", "code"),
    [((5, 5, []), 0), ((5, 5, ["a 1: X"]), 1), ((5, 4, []), 1)],
    ids=["all are known and sound", "one is weak", "one is not known"],
)
def test_what_is_known_decides_and_offline_excuses_nothing(
    monkeypatch: pytest.MonkeyPatch, answer: Asked, code: int
) -> None:
    monkeypatch.setenv("TRUEFLANK_VULNERABILITIES", "offline")
    services = answering(monkeypatch, lambda service: answer if service == "pypi" else (0, 0, []))
    assert vulnerabilities.main(ARGUMENTS) == code
    assert services == ["osv", "pypi"]


def test_an_answer_is_counted_by_what_the_data_base_knows() -> None:
    weak = {"name": "b", "version": "2", "vulns": [{"id": "Y-1", "fix_versions": ["2.1", "3"]}]}
    left_out = {"name": "c", "skip_reason": "not on the index"}
    sound = {"name": "a", "version": "1", "vulns": []}
    answer = json.dumps({"dependencies": [sound, weak, left_out]})
    assert vulnerabilities.told(answer) == (3, 2, ["b 2: Y-1, mended in 2.1, 3"])
