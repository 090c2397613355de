"""The terminal speaks the reader's language: what became of a run, progress, and an error with what to do."""

from __future__ import annotations

import pytest

from drivers.errors import ConfigError
from drivers.message import Message, Quantity
from gateway.cli.next_steps import show_outcome
from gateway.cli.output import LANGUAGE_VARIABLE, language, show_error, text_of
from gateway.workflow.run.outcome import Outcome, of_table

MOVED = Message.of("S-REPORT-PART", part="P 7", rms=Quantity(0.35, decimals=2), U=Quantity(0.1, decimals=2))
DONE = Outcome(
    "proposed",
    "runs/one",
    rows=(),
    lines=(of_table("X1", Message.of("S-MISSING-ERRORS"), Message.of("S-MISSING-RANKING")), MOVED),
    data={},
    places=(Message.of("S-REPORT-FOLDER", path="runs/one"),),
)


@pytest.mark.parametrize(
    ("reader", "wanted"),
    [
        (
            "en",
            "X1: The errors of the machine were not measured in this run. The errors were not ranked.\n"
            "run folder: runs/one\ntooth: part P 7, flank RMS 0.35 µm +- 0.10 µm (k = 2)\n",
        ),
        (
            "de",
            "X1: Die Fehler der Maschine wurden in diesem Lauf nicht gemessen. "
            "Die Fehler wurden nicht in eine Rangfolge gebracht.\n"
            "Ordner des Laufs: runs/one\nZahn: Teil P 7, Flanke RMS 0,35 µm +- 0,10 µm (k = 2)\n",
        ),
        (
            "zh",
            "X1：本次运行未测量机床误差。未对误差排序。\n"
            "运行文件夹：runs/one\n齿面：零件 P 7，RMS 0.35 µm +- 0.10 µm（k = 2）\n",
        ),
    ],
)
def test_an_outcome_is_told_in_the_readers_language(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], reader: str, wanted: str
) -> None:
    monkeypatch.setenv(LANGUAGE_VARIABLE, reader)
    show_outcome(DONE, as_json=False)
    assert capsys.readouterr().out == wanted


def test_an_error_keeps_its_code_and_says_what_to_do_in_the_readers_language(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(LANGUAGE_VARIABLE, "de")
    show_error(ConfigError("E-REPORT-LANGUAGE", "report", language="fr", known="en, de, zh"), as_json=False)
    told = capsys.readouterr().err
    assert told.startswith("E-REPORT-LANGUAGE [report]: ")
    assert "\n  -> " in told
    assert not {"the", "with", "name", "knows"} & set(told.lower().split())


def test_a_language_that_there_is_not_is_english(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(LANGUAGE_VARIABLE, "fr")
    assert language() == "en"
    assert text_of("S-AS-LEFT") == "as left"
