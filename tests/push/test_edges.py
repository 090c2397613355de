"""One value of the wrong kind, one answer at the very moment of its deadline, one exception at an entry of the journal.

More of them: N=2000 python -m pytest -m soak tests/push/test_edges.py
"""

from __future__ import annotations

import os
import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.sinumerik.mailbox.codec.registers import ADDRESS
from tests import attacks
from tests.push.edges import (
    HAIR_S,
    REGISTERS,
    WRONG,
    Count,
    at_the_deadline,
    failing_entry,
    played_mailbox,
    played_opcua,
    raised,
    wrong_register,
    wrong_value,
)
from tests.push.judging import Played

pytestmark = pytest.mark.attack

SOAK = int(os.environ.get("N", "2000"))
# What one push reads, and how many answers it gets: seeds beyond that disturb nothing, and say so.
VALUES, ANSWERS, WORDS, REPLIES, ENTRIES = 1535, 258, 11500, 480, 12
FAMILIES = {
    "value": ("a value of a wrong kind or range", "OPC UA"),
    "register": ("a value of a wrong kind or range", "mailbox"),
    "answer": ("an answer in the turn of its deadline", "OPC UA"),
    "reply": ("an answer in the turn of its deadline", "mailbox"),
    "entry": ("an exception at an entry of the journal", "mailbox"),
}
Play = Callable[[int, Path, Path], Played]


def value(seed: int, folder: Path, keys: Path) -> Played:
    """One value, or output of a method, of the wrong kind over OPC UA."""
    rng = random.Random(seed)
    wrong, count = rng.choice(WRONG), Count(rng.randrange(1, VALUES))
    found = played_opcua(seed, folder, keys, count, wrong_value(count, wrong, rng))
    found.faults.append(repr(wrong)[:40])
    return found


def answer(seed: int, folder: Path, keys: Path) -> Played:
    """One answer over OPC UA in the turn of the loop in which its deadline ends."""
    rng = random.Random(seed)
    count = Count(rng.randrange(1, ANSWERS))
    return played_opcua(seed, folder, keys, count, at_the_deadline(count, rng.choice((-HAIR_S, HAIR_S))))


def register(seed: int, folder: Path, keys: Path) -> Played:
    """One register of the mailbox out of range, or naming what is not there."""
    del keys
    rng = random.Random(seed)
    wrong, count = rng.choice(REGISTERS), Count(rng.randrange(1, WORDS))
    found = played_mailbox(seed, folder, count, wrong_register(count, wrong))
    found.faults.append(f"{wrong:#06x}")
    return found


def reply(seed: int, folder: Path, keys: Path) -> Played:
    """The same through the mailbox."""
    del keys
    rng = random.Random(seed)
    count = Count(rng.randrange(1, REPLIES))
    return played_mailbox(seed, folder, count, at_the_deadline(count, rng.choice((-HAIR_S, HAIR_S))))


def entry(seed: int, folder: Path, keys: Path) -> Played:
    """An exception at one entry of the journal, before or after it is on the disk."""
    del keys
    rng = random.Random(seed)
    count = Count(rng.randrange(1, ENTRIES))
    return played_mailbox(seed, folder, count, failing_entry(count, raised(rng), after=rng.random() < 0.5))


def play(kind: Play, seeds: range, folder: Path, keys: Path) -> Counter[str]:
    """Play them all; every one that went wrong is told, and that something was really disturbed."""
    stories = [kind(seed, folder / str(seed), keys) for seed in seeds]
    found = Counter(one.outcome for one in stories)
    wrong = [str(one) for one in stories if one.wrong]
    disturbed = [one for one in stories if not one.faults[0].startswith("nothing")]
    quiet = len(stories) - len(disturbed)
    attacks.judged(*FAMILIES[kind.__name__], (one.wrong for one in disturbed))
    print(f"{kind.__name__}, seeds {seeds.start}..{seeds.stop - 1}: {dict(found.most_common())}, undisturbed {quiet}")
    assert wrong == []
    assert quiet <= len(seeds) // 2
    return found


@pytest.mark.parametrize(("kind", "count"), [(value, 1), (answer, 1), (register, 1), (reply, 1), (entry, 1)])
def test_never_a_raw_exception_a_wrong_table_or_a_false_word(
    tmp_path: Path, keys: Path, kind: Play, count: int
) -> None:
    assert sum(play(kind, range(count), tmp_path, keys).values()) == count


@pytest.mark.parametrize("nth", [1, 4])
def test_a_cross_table_whose_input_axis_does_not_exist(tmp_path: Path, nth: int) -> None:
    count = Count(nth)
    around = wrong_register(count, 0, ADDRESS["LIVE_INPUT_AXIS"])
    found = played_mailbox(2, tmp_path / "push", count, around)
    assert count.hit
    assert found.wrong == []


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("kind", [value, answer, register, reply, entry])
def test_many_more_of_them(tmp_path: Path, keys: Path, kind: Play) -> None:
    play(kind, range(100_000, 100_000 + SOAK // 5), tmp_path, keys)
