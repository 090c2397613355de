"""Typed readings: asked for until they are numbers, kept with who and when, given as samples."""

from __future__ import annotations

import io
from collections.abc import Awaitable, Callable
from contextlib import aclosing
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.errors import ConfigError, TransportError
from drivers.manual.device import FolderPrompt, ManualEntry, QueuePrompt, ReadingPrompt, TerminalPrompt, open_prompt
from drivers.ports.instruments import AmbientSensor, Instrument, TypedInstrument
from drivers.types.sensing import SampleBlock
from tests.unit.drivers.loops import run_clean


async def typed(device: ManualEntry) -> list[SampleBlock]:
    """The blocks of one reading."""
    found = []
    async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
        async for block in stream:
            found.append(block)
            if len(found) == 2:
                return found
    return found


def asked(answers: list[str], main: Callable[[ManualEntry, QueuePrompt], Awaitable[None]], **settings: Any) -> None:
    async def wrapped() -> None:
        desk = QueuePrompt()
        for answer in answers:
            desk.answers.put_nowait(answer)
        given = {"who": "ann"} | settings
        device = ManualEntry("dial", "terminal://", given, LoopClock(), lambda _url, _clock, _where: desk)
        await device.open(5.0)
        await main(device, desk)
        await device.close()

    run_clean(wrapped, virtual=True)


def questions(desk: QueuePrompt) -> list[str]:
    return [desk.questions.get_nowait() for _ in range(desk.questions.qsize())]


def test_one_typed_value_stands_for_a_stretch_of_samples() -> None:
    async def main(device: ManualEntry, desk: QueuePrompt) -> None:
        assert isinstance(device, Instrument)
        assert isinstance(device, AmbientSensor)
        assert isinstance(device, TypedInstrument)
        first, rest = await typed(device)
        assert len(first) == 1
        assert len(rest) == 19
        assert rest.time_s[-1] - first.time_s[0] == pytest.approx(9.5)
        assert set(rest.values[:, 0].tolist()) == {12.345}
        assert rest.valid.all()
        (kept,) = device.typed
        assert (kept.text, kept.value, kept.who) == ("12.345", 12.345, "ann")
        assert kept.utc
        assert "'12.345'" in str(first.events[0])
        assert "ann" in str(first.events[0])
        (later, _rest) = await typed(device)
        assert later.time_s[0] > rest.time_s[-1]
        assert "typed" in device.notices[0]

    asked([" 12.345 \n", "12.346"], main)


def test_it_asks_again_until_it_is_a_number_and_says_why() -> None:
    async def main(device: ManualEntry, desk: QueuePrompt) -> None:
        device.expect("X 100 mm", 0.0, 50.0)
        await typed(device)
        said = questions(desk)
        assert [text.count("\n") for text in said] == [0, 1, 1, 1]
        assert "X 100 mm" in said[0]
        assert "not a plain number" in said[1]
        assert "wrong decimal mark" in said[2]
        assert device.typed[0].value == 7.5
        assert device.typed[0].label == "X 100 mm"

    asked(["abc", "7,5", "1e1", "7.5"], main)


def test_a_comma_is_a_point_only_where_the_settings_say_so() -> None:
    async def main(device: ManualEntry, _desk: QueuePrompt) -> None:
        assert (await typed(device))[0].values[0, 0] == -1.25

    asked(["1.25", "-1,25"], main, decimal="comma")


def test_what_lies_outside_the_limits_is_taken_only_when_it_is_typed_twice_running() -> None:
    async def main(device: ManualEntry, desk: QueuePrompt) -> None:
        device.expect("X 100 mm", 100.0, 0.5)
        await typed(device)
        assert device.typed[0].value == 103.0
        assert device.typed[0].insisted
        assert "typed twice" in str(device.typed[0].message)
        assert "99.5 .. 100.5 mm" in questions(desk)[1]
        await typed(device)
        assert not device.typed[1].insisted

    asked(["103.0", "104.0", "103.0", "103.0", "999"], main)


def test_the_sense_of_the_display_is_turned_and_so_are_its_limits() -> None:
    async def main(device: ManualEntry, _desk: QueuePrompt) -> None:
        device.expect("C", 5.0, 1.0)
        assert (await typed(device))[0].values[0, 0] == 5.2

    asked(["-5.2"], main, scale=-1.0, channel="angle_arcsec")


def test_a_typed_environment_is_an_environment() -> None:
    async def main(device: ManualEntry, _desk: QueuePrompt) -> None:
        ambient = await device.ambient()
        assert (ambient.air_degc, ambient.pressure_hpa, ambient.humidity_pct) == (21.5, 1003.0, None)
        assert ambient.material_degc == (20.1, 20.3)

    asked([], main, air_degc="21.5", pressure_hpa="1003", material_degc="20.1;20.3")


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"air_degc": "warm"}, "air_degc"),
        ({"air_degc": "21,5"}, "air_degc"),
        ({"pressure_hpa": "100.3"}, "pressure_hpa"),
        ({"humidity_pct": "140"}, "humidity_pct"),
        ({"channel": "displacement"}, "channel"),
        ({"decimal": "both"}, "decimal"),
        ({"scale": 2.0}, "scale"),
        ({"samples": 1}, "samples"),
        ({"hold_s": 0.0}, "hold_s"),
    ],
)
def test_wrong_settings_are_refused_by_their_key(settings: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError, match=key):
        ManualEntry("dial", "terminal://", settings, LoopClock())


def test_a_terminal_asks_and_its_end_is_told() -> None:
    out = io.StringIO()

    async def main() -> None:
        desk = TerminalPrompt("dial", io.StringIO("1.5\n"), out)
        assert await desk.ask("reading?") == "1.5\n"
        with pytest.raises(TransportError, match="terminal is closed"):
            await desk.ask("again?")
        await desk.close()

    run_clean_threads(main)
    assert out.getvalue() == "reading? again? "


def run_clean_threads(main: Callable[[], Awaitable[None]]) -> None:
    async def ended() -> None:
        import asyncio

        await main()
        await asyncio.get_running_loop().shutdown_default_executor()

    run_clean(ended, virtual=False)


def test_a_folder_asks_by_files(tmp_path: Path) -> None:
    async def main() -> None:
        import asyncio

        clock = LoopClock()
        device = ManualEntry("dial", f"folder://{tmp_path}", {}, clock)
        await device.open(5.0)
        reading = asyncio.create_task(typed(device))
        await clock.sleep(1.0)
        assert "reading 1" in (tmp_path / "question.txt").read_text()
        (tmp_path / "answer.txt").write_text("3.")
        await clock.sleep(1.0)
        assert not reading.done()
        (tmp_path / "answer.txt").write_text("3.25\n")
        assert (await reading)[0].values[0, 0] == 3.25
        await device.close()

    run_clean(main, virtual=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("url", "code"),
    [("COM3", "E-LINK-URL"), ("terminal://x", "E-LINK-URL"), ("folder:///nowhere/at/all", "E-MANUAL-FOLDER")],
)
def test_a_place_where_nobody_can_be_asked_is_refused(url: str, code: str) -> None:
    with pytest.raises(ConfigError) as caught:
        open_prompt(url, LoopClock(), "dial")
    assert caught.value.code == code


def test_desks_that_are_made() -> None:
    desks: list[ReadingPrompt] = [
        open_prompt("terminal://", LoopClock(), "dial"),
        FolderPrompt(Path(), LoopClock(), "dial"),
    ]
    assert isinstance(desks[0], TerminalPrompt)


async def test_a_closed_instrument_asks_nobody() -> None:
    with pytest.raises(TransportError, match="E-LINK-CLOSED"):
        await typed(ManualEntry("dial", "terminal://", {}, LoopClock()))
