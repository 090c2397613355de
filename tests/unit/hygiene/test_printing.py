"""What is printed: names cannot steer a terminal, turn its direction, or be taken for marks; data stays ASCII."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from jinja2 import Environment

from drivers.errors import TrueflankError
from drivers.local.names import visible
from gateway.cli.output import echo, show_error, show_json, show_table
from gateway.cli.progress import progress
from gateway.report import page
from gateway.web import app as web

EVIL = "\x1b]0;owned\x07\r\x08\x9b2J\u202egnp.\u2066\u200f\u2028\x7f\x00[bold]b[/bold]\udc80"
STEERS = {*map(chr, range(0x20)), *map(chr, range(0x7F, 0xA0)), *map(chr, range(0x202A, 0x202F))} - {"\n", "\t"}
STEERS |= {*map(chr, range(0x2066, 0x206A)), "\u200e", "\u200f", "\u2028", "\u2029", "\udc80"}


def test_every_letter_that_steers_is_shown_as_what_it_is() -> None:
    for letter in sorted(STEERS):
        assert letter not in visible(f"a{letter}b")
    assert visible("\x1b[31m\u202e\x9b") == r"\x1b[31m\u202e\x9b"
    assert visible("Prüfling µm ± −\n\tx") == "Prüfling µm ± −\n\tx"


def test_nothing_printed_steers_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    echo(f"machine {EVIL}")
    show_error(TrueflankError("E-STORE-RUN", f"w{EVIL}", run=EVIL, matches=2), as_json=False)
    show_table(f"t {EVIL}", (f"h {EVIL}", "v"), [(f"c {EVIL}", "1")])
    with progress(quiet=False) as say:
        say("P-OPEN", site=EVIL, serial=EVIL, count=1)
        say("P-STOP", axis=EVIL, program="p", done=1, total=2)
    out, err = capsys.readouterr()
    # The progress bar hides the cursor itself; no letter of a name does.
    for own in ("\x1b[?25l", "\x1b[?25h", "\x1b[2K", "\x1b[1A", "\r"):
        err = err.replace(own, "")
    assert not STEERS & set(out)
    assert not STEERS & set(err.replace("\x1b[1m", "").replace("\x1b[0m", ""))
    assert out.count("[bold]b[/bold]") >= 2
    assert "[bold]b[/bold]" in err


def test_data_is_ascii_and_comes_back_as_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    show_json({"name": EVIL, EVIL: 1})
    out = capsys.readouterr().out
    assert out.isascii()
    assert not STEERS & set(out)
    assert json.loads(out) == {"name": EVIL, EVIL: 1}


def test_one_place_prints() -> None:
    for path in sorted((Path(__file__).parents[3] / "gateway").rglob("*.py")):
        prints = re.search(
            r"(?<![.\w])(?<!def )print\(|typer\.s?echo\(|std(?:out|err)\.write\(", path.read_text(encoding="utf-8")
        )
        assert not prints or path.name == "output.py", path


def test_every_page_escapes() -> None:
    made: list[Environment] = [web._page("status.html.j2").environment, page._template().environment]
    for environment in made:
        assert environment.autoescape is True
        said = environment.from_string("{{ name }}").render(name="<script>\x1b\u202e&")
        assert said == "&lt;script&gt;\ufffd\ufffd&amp;"
    folder = Path(__file__).parents[3] / "gateway"
    assert not [path for path in folder.rglob("*.j2") if "|safe" in path.read_text().replace(" ", "")]
