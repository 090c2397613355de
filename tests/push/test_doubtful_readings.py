"""Pushes whose saved files or chunks reach the gateway changed: never anything on but old or new, never a false word.

Every line, run and pair of lines alone is refused by the strict reader (tests/unit/sinumerik/test_written.py); here
whole pushes live through a sample of them.
More of them: N=2000 python -m pytest -m soak tests/push/test_doubtful_readings.py
One again: python -m tests.push.doubtful SEED
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from tests import attacks
from tests.push import chunks, doubtful
from tests.push.doubtful import Attack, attacked, exchanged, left_out, numbered, older, without_switch

pytestmark = pytest.mark.attack

SHARDS = 4
SOAK = int(os.environ.get("N", "400"))
WRONG_READBACK = Attack("READ", 1, numbered)


ATTACKS: dict[str, tuple[tuple[Attack, ...], bool, set[str]]] = {
    # The program stands after its back-up: one that is not whole is found before anything is switched or written.
    "a back-up without one line": ((Attack("BACK", 0, left_out), WRONG_READBACK), False, {"rolled-back"}),
    "an older back-up of a cross table": ((Attack("BACK", 0, older), WRONG_READBACK), True, {"rolled-back"}),
    "a read-back without its switch": ((Attack("READ", 1, without_switch),), False, {"rolled-back"}),
    "older live tables": ((Attack("LIVE", 0, older),), False, {"raised E-SAVED-OTHER"}),
    "live tables with two lines exchanged": ((Attack("LIVE", 1, exchanged),), True, {"raised E-SAVED-LINE"}),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_a_changed_file_is_refused_and_nothing_goes_back_to_it(tmp_path: Path, keys: Path, name: str) -> None:
    attacks, cross, outcomes = ATTACKS[name]
    found = attacked(7, attacks, tmp_path / "push", keys, cross=cross)
    assert found.wrong == [], found
    assert found.outcome in outcomes


def play(seeds: range, folder: Path, keys: Path) -> Counter[str]:
    """Pushes over OPC UA; every one that went wrong is told with how to play it again."""
    stories = [doubtful.played(seed, folder / str(seed), keys) for seed in seeds]
    attacks.judged(
        "a saved file changed or of an earlier time, in a whole push", "OPC UA", (one.wrong for one in stories)
    )
    wrong = [f"{one}\n  again: python -m tests.push.doubtful {one.seed}" for one in stories if one.wrong]
    assert wrong == []
    return Counter(one.outcome for one in stories)


def play_chunks(seeds: range, folder: Path) -> Counter[str]:
    """Pushes through the mailbox."""
    stories = [chunks.played(seed, folder / str(seed)) for seed in seeds]
    attacks.judged(
        "a chunk left out, twice or of an earlier time", "mailbox", (story.wrong for story, _what in stories)
    )
    assert [f"{what}: {story.wrong}" for story, what in stories if story.wrong] == []
    return Counter(story.outcome for story, _what in stories)


def test_chunks_left_out_given_twice_or_of_an_earlier_moment(tmp_path: Path) -> None:
    found = play_chunks(range(2, 8), tmp_path)
    assert sum(found.values()) == 6
    assert found["raised E-MBX-UNSTEADY"] > 0


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("shard", range(SHARDS))
def test_many_more_changed_files(tmp_path: Path, keys: Path, shard: int) -> None:
    size = SOAK // SHARDS
    found = play(range(shard * size, (shard + 1) * size), tmp_path, keys)
    assert sum(found.values()) == size


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("shard", range(SHARDS))
def test_many_more_changed_chunks(tmp_path: Path, shard: int) -> None:
    size = SOAK // SHARDS
    found = play_chunks(range(shard * size, (shard + 1) * size), tmp_path)
    assert min(found["committed"], found["rolled-back"], found["held"]) > 0
