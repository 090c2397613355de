"""A recorded session names where a double is more lenient than the control, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.probes import ProbedSession, differences
from simulators.nck.program import names
from tests.conform.leniencies import LENIENCIES, Leniency
from tests.conform.sessions import of_control, of_double

# What tells the second shipped cell from the first (simulators/cells/scales.toml): scales at measuring system 2, cross
# tables that the builder left on, no axis 4, null strings, and switches of the tables opened to everybody.
SCALES = {
    "kind-of-message",
    "kind-of-first-alarm-text",
    "axis-numbers-in-sequence",
    "encoder-that-acts",
    "cross-tables-on",
    "right-to-switch",
}


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> ProbedSession:
    return of_control(tmp_path_factory.mktemp("control"))


@pytest.fixture
def lenient() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        yield patch
    names._first_violation.cache_clear()


@pytest.mark.long
def test_every_question_is_answered_and_the_double_agrees_with_itself(control: ProbedSession, tmp_path: Path) -> None:
    assert [answer.said for answer in control.answers if not answer.asked] == []
    assert differences(control, of_double(tmp_path, control)) == ()


@pytest.mark.long
def test_forty_leniencies_in_one_copy_are_named_and_nothing_else(
    control: ProbedSession, tmp_path: Path, lenient: pytest.MonkeyPatch
) -> None:
    for one in LENIENCIES:
        one.seed(lenient)
    found = {one.probe.name for one in differences(control, of_double(tmp_path, control))}
    assert len(LENIENCIES) == 40
    assert [one.name for one in LENIENCIES if not one.named & found] == []
    assert found - frozenset().union(*(one.named for one in LENIENCIES)) == set()


@pytest.mark.soak
@pytest.mark.parametrize("one", LENIENCIES, ids=lambda one: one.name)
def test_a_leniency_alone_is_named_and_nothing_else(
    one: Leniency, control: ProbedSession, tmp_path: Path, lenient: pytest.MonkeyPatch
) -> None:
    one.seed(lenient)
    found = {difference.probe.name for difference in differences(control, of_double(tmp_path, control))}
    assert found & one.named
    assert found <= one.named


@pytest.mark.long
def test_the_second_shipped_cell_poses_as_an_unknown_control(tmp_path: Path) -> None:
    unknown = of_control(tmp_path / "control", "scales")
    found = differences(unknown, of_double(tmp_path / "double", unknown))
    assert {one.probe.name for one in found} == SCALES
    text = unknown.as_text()
    assert not [name for name in ("YK7350B", "X1", "Z1", "127.0.0.1", "trueflank@", "4840") if name in text]
