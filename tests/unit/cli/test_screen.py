"""What people see while a command works: what must be heard is never left out, and no name of a state reaches them."""

from __future__ import annotations

import io
import json
import re
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from drivers.errors import TrueflankError, catalogue, words
from gateway.audience import KINDS, Audience, kind_of
from gateway.cli import output
from gateway.cli.next_steps import show_next
from gateway.cli.output import Voice, echo
from gateway.cli.progress import LivePanel, PanelConsole, progress
from gateway.cli.progress_state import ProgressState, clock_text
from gateway.push.phases import STEP_CODES, PushEvent, step_message
from gateway.store import Store
from gateway.store.log_book import lines_of

HELD = {"axis": "X1", "why": "no answer", "backup": "b.mpf"}


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr(output, "_chosen", {"voice": Voice.PLAIN})
    return monkeypatch


def test_every_step_that_a_push_notes_has_words_without_capitals() -> None:
    assert set(PushEvent) == set(STEP_CODES)
    for kind in (*PushEvent, "A_NEW_ONE"):
        assert not re.search(r"[A-Z]{2}", str(step_message(kind))), str(step_message(kind))


def test_who_is_asked_to_press_something_is_asked_in_every_voice() -> None:
    asking = [code for code, entry in catalogue().items() if code.startswith("P-") and "{term_start}" in entry["what"]]
    assert len(asking) >= 10
    assert {kind_of(code) for code in asking} == {Audience.ASK}
    assert set(KINDS) <= set(catalogue())
    assert {kind_of(code) for code in ("P-PUSH-HELD-ON", "P-PUSH-HELD", "P-PUSH-DISABLE-MOVES")} == {Audience.LOUD}


@pytest.mark.parametrize("chosen", list(Voice))
def test_what_must_be_heard_is_never_left_out(
    chosen: Voice, plain: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    output.use_voice(chosen)
    with progress(quiet=False) as say:
        say("P-START", axis="X1", program="TFMEASX")
        say("P-PUSH-STEP", axis="X1", step="LEASED", said=str(step_message("LEASED")))
        say("P-PUSH-HELD-ON", **HELD)
    out, told = capsys.readouterr()
    assert out == ""
    assert words("P-START", axis="X1", program="TFMEASX") in told
    assert words("P-PUSH-HELD-ON", **HELD) in told
    assert ("reserved" in told) == (chosen is Voice.VERBOSE)
    assert "\x1b" not in told


def test_a_line_of_a_pipe_is_one_line_however_long(
    plain: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with progress(quiet=False) as say:
        say("P-PROPOSED", axis="X1", words="word " * 60)
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_where_the_operator_is_simulated_nobody_here_is_asked(
    plain: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with progress(quiet=False, own_operator=True) as say:
        say("P-MOVE-STANDS", axis="X1", unit="mm", place="4")
        say("P-START", axis="X1", program="TFMEASX")
        say("P-EVALUATED", axis="X1", M="1.0", travel="1.2", B="0.5", unit="um")
        say("P-PUSH-HELD-ON", **HELD)
    told = capsys.readouterr().err
    assert "TFMEASX" not in told
    assert "is already at" not in told
    assert "still on" in told
    assert "M 1.0 µm" in told


def test_everything_is_kept_in_the_log_with_run_and_device(
    tmp_path: Path, plain: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Store(tmp_path).create("site")

    def work() -> None:
        with progress(quiet=True, folder=folder) as say:
            say("P-PUSH-STEP", axis="X1", step="LEASED", said=str(step_message("LEASED")))
            say("P-PUSH-HELD", **HELD)
            raise TrueflankError("E-PUSH-HELD", "X1", axis="X1", backup="b.mpf")

    with pytest.raises(TrueflankError):
        work()
    assert capsys.readouterr().err == ""
    kept = list(lines_of(tmp_path))
    assert [(line["level"], line["code"], line["device"]) for line in kept] == [
        ("DEBUG", "P-PUSH-STEP", "X1"),
        ("WARNING", "P-PUSH-HELD", "X1"),
        ("ERROR", "E-PUSH-HELD", "X1"),
    ]
    assert {line["run"] for line in kept} == {folder.run_id}
    assert json.dumps(kept).isascii()


def test_a_command_that_makes_no_run_of_its_own_is_known_in_the_log_from_its_devices_on(tmp_path: Path) -> None:
    site: Any = SimpleNamespace(site=SimpleNamespace(name="hall-3", store=tmp_path))
    with progress(quiet=True, at=(site, tmp_path / "site.toml")) as say:
        say("P-OPEN", site="hall-3", serial="S", count=1, run="r-1")
        say("P-UNPROTECTED", road="Modbus")
    assert [(line["code"], line["run"]) for line in lines_of(tmp_path)] == [("P-OPEN", "r-1"), ("P-UNPROTECTED", "r-1")]


def test_a_scene_knows_what_to_do_since_when_and_how_long_it_takes() -> None:
    scene = ProgressState(began=0.0)
    scene.told("P-SETUP-PLAN", {"number": 1, "total": 4, "setup": "EXX-X1"}, 0.0)
    scene.told("P-START", {"axis": "X1", "program": "TFMEASX"}, 10.0)
    assert "Press" in scene.ask
    assert scene.asked == 10.0
    for done in (1, 11):
        scene.told("P-STOP", {"axis": "X1", "program": "TFMEASX", "done": done, "total": 21}, 100.0 + done)
    assert scene.ask == ""
    inner, outer = scene.counts["inner"], scene.counts["outer"]
    assert inner.left_s(111.0) == pytest.approx(10.0)
    assert inner.left_s(111.5) == pytest.approx(9.5)
    assert inner.left_s(200.0) == pytest.approx(9.0)
    assert outer.left_s(111.0) is None
    scene.told("P-STOP", {"axis": "X1", "program": "TFMEASX", "done": 21, "total": 21}, 121.0)
    assert "inner" not in scene.counts
    scene.told("P-SETUP-PLAN", {"number": 2, "total": 4, "setup": "EYX-X1"}, 120.0)
    assert scene.counts["outer"].left_s(120.0) == pytest.approx(360.0)


def test_what_will_move_stands_with_the_question_until_it_is_answered() -> None:
    scene = ProgressState(began=0.0)
    for place in ("4", "5"):
        scene.told("P-MOVE-STANDS", {"axis": f"X{place}", "unit": "mm", "place": place}, 1.0)
    scene.told("P-START", {"axis": "X1", "program": "TFMEASX"}, 2.0)
    assert [move[:2] for move in scene.moves] == ["X4", "X5"]
    assert scene.ask
    scene.told("P-PUSH-EFFECT", {"axis": "X1", "count": 3}, 2.5)
    assert scene.moves == ()
    scene.told("P-MOVE-STANDS", {"axis": "X6", "unit": "mm", "place": "6"}, 3.0)
    assert ([move[:2] for move in scene.moves], scene.ask) == (["X6"], "")
    scene.told("P-STOP", {"axis": "X1", "program": "TFMEASX", "done": 1, "total": 21}, 4.0)
    assert scene.moves == ()


def test_a_step_of_a_batch_names_its_tables_in_one_line() -> None:
    scene = ProgressState(began=0.0)
    for step in ("DISABLE", "LOADED"):
        for axis in ("X1", "Z1", "C1-reversal"):
            scene.told("P-PUSH-STEP", {"axis": axis, "step": step, "said": str(step_message(step))}, 1.0)
        assert scene.within == f"X1, Z1, C1-reversal: {step_message(step)!s}"


def test_the_count_of_set_ups_is_gone_when_a_part_is_ground() -> None:
    """It stood at "set-up 28 of 28, about 0:00 to go" while parts were ground and tables pushed."""
    scene = ProgressState(began=0.0)
    scene.told("P-SETUP-PLAN", {"number": 28, "total": 28, "setup": "EZZ-Z1"}, 0.0)
    scene.told("P-MEASURE", {"axis": "Z1", "component": "EZZ", "phase": "before"}, 0.0)
    assert "outer" in scene.counts
    scene.told("P-PART", {"part": "before", "x_um": 0.0, "c_arcsec": 0.0, "dressing_um": 0.0}, 1.0)
    assert scene.counts == {}


def test_minutes_are_said_as_a_clock() -> None:
    assert [clock_text(one) for one in (5.4, 65, 3661)] == ["0:05", "1:05", "1:01:01"]


@pytest.mark.parametrize("width", [100, 160])
def test_the_panel_says_what_to_do_and_since_when_in_every_width(width: int) -> None:
    told, time = io.StringIO(), {"now": 0.0}
    console = PanelConsole(file=told, width=width, force_terminal=True, highlight=False)
    with LivePanel("trueflank: site", ProgressState(began=0.0), lambda: time["now"], console) as panel:
        panel.told("P-SETUP-PLAN", {"number": 3, "total": 28, "setup": "EXX-X1"})
        panel.told("P-START-SETUP", {"axis": "X1", "program": "TFSENSEX", "setup": "TRUEFLANK SETUP EXX ON X"})
        panel.keep("X1: sign proved")
        time["now"] = 42.0
        drawn = io.StringIO()
        Console(file=drawn, width=width).print(panel.drawn())
    text = drawn.getvalue()
    assert all(len(line) <= width for line in text.splitlines())
    assert text.count("of 28") == 1
    for part in ("Mount what the control asks for", "Press", "waiting for this 0:42", "set-up 3 of 28"):
        assert part in " ".join(text.replace("\u2502", " ").split()), part
    assert "X1: sign proved" in told.getvalue()


class _Slow:
    """What takes its time to be drawn: long enough for another thread to draw the panel, if it may."""

    def __init__(self, other: threading.Thread) -> None:
        self._other = other

    def __rich_console__(self, *_how: object) -> Iterator[str]:
        self._other.start()
        self._other.join(0.3)
        yield "kept for good"


def _screen(written: str) -> list[str]:
    """The lines that stand on a terminal in the end, of what moves up, erases and goes on."""
    lines, at = [""], 0
    for part in re.findall(r"\x1b\[[0-9;?]*[A-Za-z]|\r|\n|[^\x1b\r\n]+", written):
        if part == "\n":
            at += 1
            lines += [""] * (at + 1 - len(lines))
        elif part.endswith("A") and part[0] == "\x1b":
            at = max(at - int(part[2:-1] or 1), 0)
        elif part == "\x1b[2K":
            lines[at] = ""
        elif part[0] not in "\x1b\r":
            lines[at] += part
    return lines


def test_a_line_stays_whatever_the_panel_does_while_it_is_printed() -> None:
    """A panel that got shorter while a line above it was printed took lines with it."""
    written = io.StringIO()
    console = PanelConsole(file=written, width=100, force_terminal=True, force_interactive=True, highlight=False)
    with LivePanel("trueflank: site", ProgressState(began=0.0), lambda: 0.0, console) as panel:
        panel.told("P-MOUNT", {"setup": "EXX-X1", "words": "mount it"})
        panel.told("P-START", {"axis": "X1", "program": "TFMEASX"})
        panel.keep("X1: sign proved")
        panel.refresh()
        panel.told("P-EVALUATED", {})
        console.print(_Slow(threading.Thread(target=panel.refresh)))
        panel.refresh()
    stays = [line for line in _screen(written.getvalue()) if line]
    assert stays == ["X1: sign proved", "kept for good"]


@pytest.mark.skipif(sys.platform == "win32", reason="its console echoes no Ctrl-C")
def test_a_ctrl_c_is_not_echoed_into_the_panel(monkeypatch: pytest.MonkeyPatch) -> None:
    """The echo went to the next line, and two lines of the panel stayed on the screen."""
    import pty
    import termios

    ours, theirs = pty.openpty()
    with open(ours, "wb", buffering=0), open(theirs, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        flags = [termios.tcgetattr(stdin)[3]]
        with LivePanel("trueflank: site", ProgressState(began=0.0), lambda: 0.0, PanelConsole(file=io.StringIO())):
            flags.append(termios.tcgetattr(stdin)[3])
        flags.append(termios.tcgetattr(stdin)[3])
    assert [bool(one & termios.ECHOCTL) for one in flags] == [True, False, True]
    assert flags[0] == flags[2]


def test_what_is_echoed_meanwhile_stands_above_the_panel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Click, left to find the stream, wrote into the panel: the line was lost, and half of the panel stayed."""
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(io.BytesIO(), encoding="utf-8"))
    written = io.StringIO()
    console = PanelConsole(file=written, width=100, force_terminal=True, force_interactive=True, highlight=False)
    with LivePanel("trueflank: site", ProgressState(began=0.0), lambda: 0.0, console) as panel:
        panel.told("P-RUN", {"folder": "runs/1"})
        panel.refresh()
        echo("stopping", err=True)
    assert [line for line in _screen(written.getvalue()) if line] == ["stopping"]


def test_a_terminal_gets_lines_broken_between_words_and_a_command_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    for isatty, lines in ((True, 4), (False, 1)):
        stream = io.StringIO()
        monkeypatch.setattr(stream, "isatty", lambda isatty=isatty: isatty)
        monkeypatch.setattr(sys, "stdout", stream)
        echo("mounted " * 15)
        assert len(stream.getvalue().splitlines()) == lines
        show_next("push " + "latest " * 15)
        assert len(stream.getvalue().splitlines()) == lines + 1


def test_a_terminal_gets_the_panel(plain: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    plain.setattr(sys.stderr, "isatty", lambda: True)
    with progress(quiet=False) as say:
        say("P-MOVE-STANDS", axis="X1", unit="mm", place="4")
        say("P-START", axis="X1", program="TFMEASX")
        say("P-EVALUATED", axis="X1", M="1.0", travel="1.2", B="0.5", unit="um")
    assert "M 1.0 µm" in capsys.readouterr().err
