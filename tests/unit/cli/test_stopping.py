"""A stop is one thing, whoever asks: one cancel, time for who leaves in order, an end in any case, the words of it."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Coroutine, Iterator
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import TransportError
from gateway.cli.signals import SIGNALS, run_to_end
from gateway.stopping import LONGEST_S, StopAsked, Stopped, current, obey

HERE = [name for name in SIGNALS if hasattr(signal, name)]


async def _waits_for_ever() -> None:
    await asyncio.Event().wait()


@pytest.fixture(autouse=True)
def heard() -> Iterator[None]:
    """A shell's background job ignores Ctrl-C, and what nohup started ignores SIGHUP; these tests ask for both."""
    before = {name: signal.signal(getattr(signal, name), signal.SIG_DFL) for name in HERE}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for name, handler in before.items():
        signal.signal(getattr(signal, name), handler)


@pytest.mark.parametrize("name", HERE)
def test_each_signal_of_the_system_is_the_same_stop(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(getattr(signal, name))

    async def work() -> None:
        asyncio.get_running_loop().call_soon(signal.raise_signal, getattr(signal, name))
        await _waits_for_ever()

    with pytest.raises(Stopped) as caught:
        run_to_end(work())
    assert caught.value.exit_code == (130 if name == "SIGINT" else 143)
    assert ("Ctrl-C" if name == "SIGINT" else name) in caught.value.what
    assert "leaving the machine in a safe state" in capsys.readouterr().err
    assert signal.getsignal(getattr(signal, name)) is before


def test_a_signal_that_whoever_started_us_ignores_is_not_heard() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:

        async def work() -> str:
            signal.raise_signal(signal.SIGINT)
            await asyncio.sleep(0)  # noqa: TID251 - a turn of the loop, no time
            return "done"

        assert run_to_end(work()) == "done"
    finally:
        signal.signal(signal.SIGINT, before)


def asked(work: Coroutine[Any, Any, Any], *moments: float, ends_itself: bool = False) -> tuple[Any, float]:
    """Do some work in virtual time with stops asked for at these moments: (its result or Stopped, when it ended)."""

    async def main() -> tuple[Any, float]:
        clock, stop = LoopClock(), StopAsked()
        clock.now()

        async def ask() -> None:
            for moment in moments:
                await clock.sleep(moment - clock.now())
                stop.ask("SIGTERM")

        asking = asyncio.create_task(ask())
        try:
            found: Any = await obey(work, stop, clock, ends_itself=ends_itself)
        except Stopped as error:
            found = error
        finally:
            asking.cancel()
            await asyncio.gather(asking, return_exceptions=True)
        return found, clock.now()

    return run_virtual(main)


def test_a_second_asking_does_not_cut_the_leaving_off() -> None:
    done: list[str] = []

    async def work() -> None:
        try:
            await _waits_for_ever()
        except asyncio.CancelledError:
            with current().leaving():
                await LoopClock().sleep(12.0)
            done.append("left in order")
            current().tell("all is as before")
            raise

    found, ended = asked(work(), 1.0, 2.0, 5.0)
    assert done == ["left in order"]
    assert isinstance(found, Stopped)
    assert "all is as before" in found.what
    assert ended == pytest.approx(13.0, abs=0.1)


def test_a_cancel_that_a_library_swallows_is_asked_for_again() -> None:
    async def work() -> None:
        for _swallowed in range(2):
            try:
                await _waits_for_ever()
            except asyncio.CancelledError:
                continue
        await _waits_for_ever()

    found, ended = asked(work(), 1.0)
    assert isinstance(found, Stopped)
    assert ended == pytest.approx(5.0, abs=0.1)


def test_a_leaving_without_end_ends_all_the_same() -> None:
    async def work() -> None:
        try:
            await _waits_for_ever()
        finally:
            with current().leaving():
                await _waits_for_ever()

    found, ended = asked(work(), 1.0)
    assert isinstance(found, Stopped)
    assert ended <= 1.0 + LONGEST_S + 2.0


def test_what_fails_because_of_the_stop_is_told_with_it() -> None:
    async def work() -> None:
        try:
            await _waits_for_ever()
        except asyncio.CancelledError as cancel:
            raise TransportError("E-UA-BROKEN", "840D", why="interrupted") from cancel

    found, _ended = asked(work(), 1.0)
    assert isinstance(found, Stopped)
    assert "E-UA-BROKEN" in found.what


def test_what_was_done_before_the_stop_counts() -> None:
    async def work() -> str:
        await LoopClock().sleep(0.5)
        return "done"

    assert asked(work(), 1.0) == ("done", pytest.approx(0.5, abs=0.01))


def test_what_ends_by_itself_is_not_cancelled() -> None:
    async def work() -> str:
        await current().asked.wait()
        await LoopClock().sleep(4.0)
        return "ended by itself"

    assert asked(work(), 1.0, ends_itself=True) == ("ended by itself", pytest.approx(5.0, abs=0.1))


def test_a_failure_of_the_work_itself_passes() -> None:
    async def work() -> None:
        raise TransportError("E-UA-BROKEN", "840D", why="no")

    with pytest.raises(TransportError):
        asked(work())
