"""What stays of a comparison: the session read again, a test that fails until the double is cured, rows of a page."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.errors import FileFormatError
from drivers.probes import Answer, Probe, ProbedSession, differences, read_session
from gateway.acceptance.comparison import written
from tests.conform.leniencies import LENIENCIES
from tests.conform.sessions import of_control, of_double


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> ProbedSession:
    return of_control(tmp_path_factory.mktemp("control"), allow="read")


def _other(session: ProbedSession, name: str, said: str) -> ProbedSession:
    answers = tuple(replace(one, said=said) if one.probe.name == name else one for one in session.answers)
    return replace(session, answers=answers)


def test_reading_questions_alone_need_nobody_at_the_machine(control: ProbedSession, tmp_path: Path) -> None:
    assert {answer.probe.allow for answer in control.answers} == {"read"}
    assert control.said("fetch-missing") == "BadNotFound"
    assert control.about["allow"] == "read"
    assert differences(control, of_double(tmp_path, control)) == ()


def test_leniencies_that_reading_alone_can_tell_are_named(
    control: ProbedSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    probes = {answer.probe.name for answer in control.answers}
    seeded = [one for one in LENIENCIES if one.named & probes and not one.name.startswith("rule")]
    for one in seeded:
        one.seed(monkeypatch)
    found = {one.probe.name for one in differences(control, of_double(tmp_path, control))}
    assert len(seeded) > 5
    assert [one.name for one in seeded if not one.named & found] == []
    assert found <= frozenset().union(*(one.named for one in seeded))


def test_a_comparison_leaves_session_test_and_rows(control: ProbedSession, tmp_path: Path) -> None:
    real = _other(control, "select-missing", "Good 4")
    (found,) = differences(real, control)
    assert found.line.startswith("select-missing: control says Good 4 / double says Good 2 (")
    files = written(tmp_path, real, (found,), "zero")
    assert [file.name for file in files] == ["session.json", "test_double.py", "rows.md"]
    assert read_session(files[0]) == real
    assert files[2].read_text().splitlines()[-1] == "| selecting a program that does not exist | Good 4 | Good 2 |"
    assert [file.name for file in written(tmp_path, control, (), "zero")] == ["session.json"]
    assert not files[1].exists()


@pytest.mark.long
def test_the_written_test_fails_until_the_double_says_the_same(control: ProbedSession, tmp_path: Path) -> None:
    real = _other(control, "select-missing", "Good 4")
    files = written(tmp_path, real, differences(real, control), "zero")
    plain = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", str(files[1])]
    ended = subprocess.run(plain, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 1, ended.stdout + ended.stderr
    assert "'Good 2' == 'Good 4'" in ended.stdout


def test_a_question_that_was_not_asked_makes_no_difference() -> None:
    probe = Probe("a", "write", "a value", "program", ("M30",))
    one, other = ProbedSession({}, (Answer(probe, "Good"),)), ProbedSession({}, (Answer(probe, "not asked: no table"),))
    assert differences(one, other) == differences(other, one) == ()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda tree: tree.update(trueflank_session=2), "not a recorded session of form 1"),
        (lambda tree: tree["answers"].append({}), "an entry has"),
        (lambda tree: tree["answers"][0].update(allow="all"), "wrong type"),
        (lambda tree: tree["answers"][0].update(ask=[None]), "texts and numbers"),
        (lambda tree: tree["answers"].append(tree["answers"][0]), "is there twice"),
    ],
)
def test_a_file_that_is_no_session_is_refused_with_its_entry(
    change: object, why: str, control: ProbedSession, tmp_path: Path
) -> None:
    tree = json.loads(control.as_text())
    change(tree)  # type: ignore[operator]
    path = tmp_path / "session.json"
    path.write_text(json.dumps(tree))
    with pytest.raises(FileFormatError, match=why):
        read_session(path)
