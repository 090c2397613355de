"""A stop asked for by the system, and kill -9, at seeded moments of a run that pushes: what is said then is true."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from gateway.errors import RollbackFailed
from gateway.push import recovery
from gateway.push.restore import hold
from tests import attacks
from tests.cell.stops import ACTIVE, RESET, Killing, Moment, Shop, cleared, come, shop, stopped, table_of

pytestmark = pytest.mark.attack

RUN_S = 41.5  # from the start almost to the last word, where nobody stops it
SERVED_S = 6.5  # the same for a run that only proposes, started at a daemon's desk
JOURNAL_S, STOP_S = 5.0, 30.0


def moments(count: int, seed: int) -> list[float]:
    """Seeded moments of a run, one in each of so many equal parts of it."""
    rng = random.Random(seed)
    return [RUN_S * (part + rng.random()) / count for part in range(count)]


# How the last line names each finding: as a part of E-STOPPED it has no code of its own.
SENTENCES = {
    "W-LEFT-ASKED": "is stopped with a request to end",
    "W-LEFT-FINISHING": "is running with a request to end",
}


async def _stopped_at(at: Shop, moment: Moment, *, alone: bool, off: tuple[float, ...]) -> tuple[str, list[str]]:
    """Stop a run there; ``alone``: whoever stood at the machine has gone. (What it was, what is wrong.)"""
    wrong: list[str] = []
    began = at.clock.utc()
    how = await stopped(at, at.work(), moment, lambda: at.cell.operator.change(auto=not alone))
    if how.error is None:
        return "it was over", wrong
    if how.took_s > STOP_S:
        wrong.append(f"it took {how.took_s:.1f} s")
    if how.error.exit_code != 143 or ("SIGTERM" in how.error.what and not how.told):
        wrong.append(f"its last word: {how.error}")
    for one in at.journal():
        noted = datetime.fromisoformat(str(one.entries[-1].facts["utc"]))
        late_s = (noted - began).total_seconds() - how.asked_s
        if one.kinds[-1] != "STOPPED" or late_s > JOURNAL_S:
            wrong.append(f"the journal says {one.kinds[-1]} {late_s:.1f} s after the asking")
    told = " ".join(how.told)
    what = _judged(at, told, wrong)
    await _looked(at, wrong, unfinished=bool(at.journal()))
    points, on = table_of(at.cell)
    if on and points != off and "ENABLE" not in str(at.journal()):
        wrong.append("a table is on that nobody was told of")
    return what, wrong


def _judged(at: Shop, told: str, wrong: list[str]) -> str:
    """The last word against the control's state."""
    if at.channel == RESET:
        if any(at.words):
            wrong.append(f"the channel is in reset and R parameters are {at.words}")
        if "request to end" in told:
            wrong.append(f"nothing runs, and it says: {told}")
        return "ended"
    wanted = "W-LEFT-FINISHING" if at.channel == ACTIVE else "W-LEFT-ASKED"
    if SENTENCES[wanted] not in told or "W-LEFT" in told:
        wrong.append(f"channel {at.channel}, and it says: {told or 'nothing'}")
    return wanted


async def _looked(at: Shop, wrong: list[str], *, unfinished: bool) -> None:
    """The page against the control's state: never ready while something of ours is there."""
    while at.cell.nck.booting:
        await at.clock.sleep(0.5)
    left, codes = await at.page()
    ours = at.channel != RESET or any(at.words)
    if ours and left.clear:
        wrong.append(f"channel {at.channel}, words {at.words}: the page says nothing is left")
    would_start = left.code == "W-LEFT-SELECTED" and at.program.rpartition("/")[2].startswith("_N_TF")
    if not ours and not left.clear and not would_start:
        wrong.append(f"nothing is left, and the page says {left.words}")
    if unfinished and not any(code.startswith("R-HELD-") for code in codes):
        wrong.append("a push did not end, and the page does not say so")


def stops(folder: Path, when: Sequence[Moment]) -> Counter[str]:
    """Stop a run at these moments, each time cleared up by a person afterwards."""
    seen: Counter[str] = Counter()
    problems: list[str] = []
    judged: list[list[str]] = []

    async def main() -> None:
        async with shop(folder) as at:
            before = table_of(at.cell)[0]
            for number, moment in enumerate(when):
                what, wrong = await _stopped_at(at, moment, alone=bool(number % 2), off=before)
                wrong += await cleared(at)
                seen[what] += 1
                judged.append(wrong)
                problems.extend(f"at {moment} ({what}): {one}" for one in wrong)

    run_virtual(main)
    attacks.judged("a stop (SIGTERM) at a seeded moment of a run", "OPC UA", judged)
    if problems:
        raise AssertionError("\n".join(problems))
    return seen


def test_a_stop_at_any_moment_of_a_run_leaves_the_machine_as_told(tmp_path: Path) -> None:
    """A program between the halves of a push ends by itself; one at M0 is asked of a person in a process of its own."""
    assert stops(tmp_path, ("after the back-up", "at the restart")) == {"ended": 1, "W-LEFT-ASKED": 1}


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(3))
def test_stops_at_thirty_moments(tmp_path: Path, seed: int) -> None:
    found = stops(tmp_path, moments(30, seed))
    print(dict(found))
    assert sum(found.values()) == 30


def served(folder: Path, count: int, seed: int) -> Counter[str]:
    """Stop a daemon with a run at work that only proposes."""
    seen: Counter[str] = Counter()
    problems: list[str] = []
    judged: list[list[str]] = []
    rng = random.Random(seed)

    async def main() -> None:
        async with shop(folder) as at:
            for number in range(count):
                moment, wrong, alone = SERVED_S * (number + rng.random()) / count, list[str](), bool(number % 2)

                def leave(alone: bool = alone) -> None:
                    at.cell.operator.change(auto=not alone)

                how = await stopped(at, at.served(), moment, leave, ends_itself=True)
                what = _judged(at, " ".join(how.told), wrong)
                wrong += [f"it took {how.took_s:.1f} s"] if how.took_s > STOP_S else []
                await _looked(at, wrong, unfinished=False)
                wrong += await cleared(at)
                seen[what] += 1
                judged.append(wrong)
                problems.extend(f"at {moment} ({what}): {one}" for one in wrong)

    run_virtual(main)
    attacks.judged("a stop (SIGTERM) at a seeded moment of the daemon", "OPC UA", judged)
    if problems:
        raise AssertionError("\n".join(problems))
    return seen


@pytest.mark.soak
def test_stops_of_the_daemon_at_thirty_moments(tmp_path: Path) -> None:
    assert sum(served(tmp_path, 30, seed=2).values()) == 30


def kills(folder: Path, when: Sequence[Moment], killing: Killing) -> Counter[str]:
    """Kill the gateway of a run at these moments; each time somebody finds the machine and has it cleared up."""
    seen: Counter[str] = Counter()
    problems: list[str] = []
    judged: list[list[str]] = []

    async def main() -> None:
        async with shop(folder) as at:
            for number, moment in enumerate(when):
                async with killing.gateway(at.work()) as task:
                    await come(at, moment)
                    at.cell.operator.change(auto=bool(number % 2) and not isinstance(moment, str))
                    killing.kill(task)
                    await at.clock.sleep(40.0)
                    what, wrong = await _found_after_the_kill(at)
                    wrong += await cleared(at, resets=bool(number % 3))
                    seen[what] += 1
                    judged.append(wrong)
                problems.extend(f"at {moment} ({what}): {one}" for one in wrong)

    run_virtual(main)
    attacks.judged("kill -9 at a seeded moment of a run", "OPC UA", judged)
    if problems:
        raise AssertionError("\n".join(problems))
    return seen


async def _found_after_the_kill(at: Shop) -> tuple[str, list[str]]:
    wrong: list[str] = []
    left, _codes = await at.page()
    await _looked(at, wrong, unfinished=bool(at.journal()))
    said = [finding.words for finding in await at.recovery(apply=False)] if not left.clear else []
    if not left.clear and not any(left.code in words for words in said):
        wrong.append(f"recover says {said}, the page {left.code}")
    return left.code, wrong


def test_what_a_killed_gateway_left_is_known_by_its_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = kills(tmp_path, ("between the halves", "at the restart"), Killing(monkeypatch))
    assert found == {"W-LEFT-WAITING": 1, "W-LEFT-STOPPED": 1}


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(3))
def test_kills_at_thirty_moments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    found = kills(tmp_path, moments(30, seed), Killing(monkeypatch))
    print(dict(found))
    assert sum(found.values()) == 30


@pytest.mark.long
def test_a_recovery_that_leaves_the_old_table_out_ends_as_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Held is no success, though all is off; where the way back works again, the next recovery takes it."""

    async def main() -> None:
        async with shop(tmp_path) as at:
            await stopped(at, at.work(), "between the halves", lambda: None)
            with monkeypatch.context() as patch:
                patch.setattr(recovery, "roll_back", hold)
                with pytest.raises(RollbackFailed) as caught:
                    await at.recovery(apply=True)
            assert (caught.value.code, caught.value.exit_code) == ("E-PUSH-HELD", 9)
            assert await cleared(at) == []

    run_virtual(main)
