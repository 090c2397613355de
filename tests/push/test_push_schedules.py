"""Pushes with seeded faults on both roads: never a corrupted table that is on, and every failure leads home or holds.

Among the faults are controls that exchange points, switch on or forget by themselves: what is then held is off, or
told as still on.

More of them: PUSHES=20000 python -m pytest -m soak tests/push/test_push_schedules.py
One again: python -m tests.push.schedules SEED
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from tests import attacks
from tests.push import schedules, uaschedules
from tests.sizes import few

pytestmark = pytest.mark.attack

FAMILY = "seeded faults of wire, control, people and disk; controls that swap, switch or forget by themselves"
SHARDS = 36
MODBUS = 900
# One push in five commits: 25 seeds in a row without one are a finding, five are not. The first five hold one.
OPCUA = [range(5), *(range(begin, begin + 25) for begin in range(5, 105, 25))]
SOAK = int(os.environ.get("PUSHES", "10000"))


def play(seeds: range, folder: Path) -> Counter[str]:
    """Play them all; every one that went wrong is told with how to play it again."""
    found: Counter[str] = Counter()
    stories = [schedules.played(seed, folder / str(seed)) for seed in seeds]
    found.update(one.outcome for one in stories)
    wrong = [f"{one}\n  again: python -m tests.push.schedules {one.seed}" for one in stories if one.wrong]
    attacks.judged(FAMILY, "mailbox", (one.wrong for one in stories))
    print(f"seeds {seeds.start}..{seeds.stop - 1}: {dict(found.most_common())}")
    assert wrong == []
    return found


@pytest.mark.parametrize("shard", few(range(SHARDS), more=3))
def test_seeded_faults_on_the_mailbox(tmp_path: Path, shard: int) -> None:
    size = MODBUS // SHARDS
    found = play(range(shard * size, (shard + 1) * size), tmp_path)
    assert sum(found.values()) == size
    assert min(found["committed"], found["rolled-back"], found["held"]) > 0


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("shard", range(SHARDS))
def test_many_more_seeded_faults_on_the_mailbox(tmp_path: Path, shard: int) -> None:
    size = SOAK * 9 // 10 // SHARDS
    play(range(100_000 + shard * size, 100_000 + (shard + 1) * size), tmp_path)


def play_opcua(seeds: range, folder: Path, keys: Path) -> Counter[str]:
    """The same over OPC UA."""
    found: Counter[str] = Counter()
    stories = [uaschedules.played(seed, folder / str(seed), keys) for seed in seeds]
    found.update(one.outcome for one in stories)
    wrong = [f"{one}\n  again: python -m tests.push.uaschedules {one.seed}" for one in stories if one.wrong]
    attacks.judged(FAMILY, "OPC UA", (one.wrong for one in stories))
    print(f"OPC UA, seeds {seeds.start}..{seeds.stop - 1}: {dict(found.most_common())}")
    assert wrong == []
    return found


@pytest.mark.parametrize("seeds", few(OPCUA, 1, 2), ids=str)
def test_seeded_faults_over_opcua(tmp_path: Path, keys: Path, seeds: range) -> None:
    found = play_opcua(seeds, tmp_path, keys)
    assert sum(found.values()) == len(seeds)
    assert found["committed"] > 0


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("shard", range(SHARDS))
def test_many_more_seeded_faults_over_opcua(tmp_path: Path, keys: Path, shard: int) -> None:
    size = SOAK // 10 // SHARDS
    play_opcua(range(100_000 + shard * size, 100_000 + (shard + 1) * size), tmp_path, keys)
