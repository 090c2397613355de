"""What the screen says that the control shows is what it shows, whenever a program waits for a person."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.errors import words
from drivers.programs import Moment
from drivers.sinumerik.opcua.measuring import message_at, waiting_messages
from gateway.config import load_site
from gateway.push import push_table
from gateway.workflow.programs import programs
from tests.push.uaworld import UaWorld, ua_change, ua_context, ua_world
from tests.unit.programs.sites import site_file

SHOWN: dict[str, Moment] = {
    "P-PUSH-ACTIVATE": "restart",
    "P-GRIND-BEGUN": "clamp",
    "P-GRIND-DONE": "unclamp",
    "P-SELF-TEST": "self-test",
}


async def watched(at: UaWorld, seen: list[str]) -> None:
    """Every message that stands on the control while it waits, once."""
    while True:
        await at.clock.sleep(0.1)
        if at.nck.channel_status == 2 and at.nck.message not in ("", *seen[-1:]):
            seen.append(at.nck.message)


@pytest.mark.parametrize("two_programs", [False, True])
async def test_a_push_quotes_what_the_control_shows(tmp_path: Path, keys: Path, two_programs: bool) -> None:
    """Nothing waits for a person before the restart; where the first half is a program of its own, two are started."""
    seen: list[str] = []
    told: dict[str, str] = {}
    async with ua_world(LoopClock(), keys) as at:
        at.spawn(watched(at, seen))
        device = at.driver(two_programs=two_programs)
        await device.open(5.0)
        base = await at.base(device)

        def say(code: str, /, **fields: object) -> None:
            told[code] = words(code, **fields)
            at.person.hear(code, fields)

        context = ua_context(device, at.clock, tmp_path, await device.identify(), say=say)
        record = await push_table(ua_change(base, at.new), context)
        await device.close()
    assert record.outcome == "committed", record.steps
    assert [told["P-PUSH-ACTIVATE"].partition("The control shows: ")[2]] == seen
    assert ("P-PUSH-RELEASE" in told) is two_programs
    assert ("P-PUSH-START" in told) is not two_programs


def test_every_wait_of_every_program_has_its_moment(tmp_path: Path) -> None:
    """What waits and is none of these is a mounting, whose message the plan itself carries."""
    path = site_file(tmp_path, "demo")
    known = set()
    for one in programs(load_site(path), path, ("self-test", "measure", "load", "proof", "grind", "off")):
        waits = {text for text in waiting_messages(one.program.text) if not text.startswith("TRUEFLANK SETUP ")}
        found = {moment: message_at(one.program.text, moment) for moment in SHOWN.values()}
        assert waits == {text for text in found.values() if text}, one.name
        known |= {moment for moment, text in found.items() if text}
    assert known == set(SHOWN.values())


@pytest.mark.parametrize("code", SHOWN)
def test_the_text_of_each_moment_says_it(code: str) -> None:
    """One act a sentence, and what the control shows at the end."""
    text = words(code, shown=" The control shows: TRUEFLANK X")
    assert text.endswith("The control shows: TRUEFLANK X")
    assert ";" not in text.partition("The control shows")[0].partition("nothing moves")[2]
