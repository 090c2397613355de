"""A message is a code with fields until somebody reads it: in three languages, with their numbers, one or many."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest

from drivers import catalogue
from drivers.errors import DeviceRefused, words
from drivers.message import Form, Message, Moment, Quantity, joined, render
from gateway.errors import CorruptRecord
from gateway.store import records

ERROR = DeviceRefused("E-PUSH-ROLLED-BACK", "X1", axis="X1", why="?", backup="run/x.tea")


@pytest.fixture
def texts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four texts of our own in each language."""
    own = {
        "en": {"A": "{size} more, {count:# target|# targets}", "B": "{why}; {x:+.2f} um", "C": "none", "D": "{ends}"},
        "de": {"A": "{size} mehr, {count:# Punkt|# Punkte}", "B": "{why}; {x:+.2f} um", "C": "nichts", "D": "{ends}"},
        "zh": {"A": "多 {size}，{count:# 个点}", "B": "{why}；{x:+.2f} um", "C": "无", "D": "{ends}"},
    }
    blocks = {lang: {code: f"what = '{text}'\ndo = 'go'" for code, text in own[lang].items()} for lang in own}
    monkeypatch.setattr(catalogue, "_blocks", blocks.__getitem__)


@pytest.mark.usefixtures("texts")
def test_a_quantity_has_the_decimal_sign_and_a_count_the_form_of_the_language() -> None:
    several = Message("A", {"size": Quantity(0.35, "µm", 2), "count": 3})
    one = Message("A", {"size": Quantity(-1.5, "µm"), "count": 1})
    assert render(several) == "0.35 µm more, 3 targets"
    assert render(one) == "-1.5 µm more, 1 target"
    assert render(several, "de") == "0,35 µm mehr, 3 Punkte"
    assert render(one, "de") == "-1,5 µm mehr, 1 Punkt"
    assert render(one, "zh") == "多 -1.5 µm，1 个点"
    assert render(Message("A", {"size": "x", "count": 0})).endswith("0 targets")


@pytest.mark.usefixtures("texts")
def test_a_message_within_a_message_is_in_the_readers_language_too() -> None:
    inner = Message("C", {}, Form.ERROR, where="X1")
    outer = Message("B", {"why": inner, "x": 0.25})
    assert render(outer) == "C [X1]: none -> go; +0.25 µm"
    assert render(outer, plain=True) == "none -> go; +0.25 µm"
    assert render(outer, "de", plain=True) == "nichts -> go; +0,25 µm"
    assert render(outer, "zh", plain=True) == "无 -> go；+0.25 µm"
    several = Message("D", {"ends": ("X1", Quantity(1.5, "mm"), Message("C"))})
    assert [render(several, of) for of in ("en", "de", "zh")] == [
        "X1, 1.5 mm, none",
        "X1, 1,5 mm, nichts",
        "X1、1.5 mm、无",
    ]
    assert joined((Message("C"), Message("C", form=Form.REASON)), "de") == "nichts; C: nichts"
    assert render(Message("D", {"ends": Moment("2026-01-02T03:04:05+00:00")})) == "2026-01-02T03:04:05+00:00"


def test_an_error_as_a_message_reads_as_the_error_itself() -> None:
    assert str(ERROR.message) == str(ERROR)
    assert render(ERROR.message, plain=True).startswith(ERROR.what)
    why = DeviceRefused("E-PUSH-ROLLED-BACK", "X1", axis="X1", why=ERROR, backup="-")
    assert str(ERROR) in str(why)
    assert why.message.fields["why"] == ERROR.message
    recorded = why.as_record()["fields"]
    assert isinstance(recorded, dict)
    assert recorded["why"]["code"] == ERROR.code
    assert recorded["why"]["fields"]["axis"] == "X1"


def test_what_an_older_version_stored_finished_is_shown_as_stored() -> None:
    old = Message.from_data("the old table was restored: 0.35 um")
    assert [render(old, of) for of in ("en", "de", "zh")] == ["the old table was restored: 0.35 um"] * 3


def test_json_and_back_keeps_every_kind_of_field() -> None:
    fields = {
        "axis": "X1",
        "n": 3,
        "yes": True,
        "none": None,
        "size": Quantity(0.35, "um", 2, signed=True),
        "nan": float("inf"),
        "at": Moment("2026-01-02T03:04:05+00:00"),
        "why": ERROR.message,
        "several": (Quantity(1.0, "mm"), "two", Message("P-RUN", {"folder": "r"})),
    }
    message = Message("W-X", fields, Form.REASON, where="here")
    back = Message.from_data(json.loads(json.dumps(message.as_data(), allow_nan=False)))
    assert back == message
    assert hash(back) == hash(message)


def test_a_message_keeps_only_what_json_has_a_form_for() -> None:
    made = Message("W-X", {"a": np.float64(1.5), "b": np.int64(2), "c": Form.ERROR, "d": ValueError("x"), "e": [1, 2]})
    assert made.fields == {"a": 1.5, "b": 2, "c": "error", "d": "x", "e": (1, 2)}
    assert json.dumps(made.as_data())


@pytest.mark.parametrize("data", [None, 3, {"code": "X"}, {"code": "X", "fields": {"a": {"b": 1}}}, {"fields": {}}])
def test_what_is_no_message_is_refused(data: object) -> None:
    with pytest.raises(ValueError, match="message"):
        Message.from_data(data)


@dataclass(frozen=True)
class Kept:
    """A record with messages."""

    steps: tuple[Message, ...]
    last: Message | None = None


def test_the_store_keeps_messages_and_reads_the_sentences_of_older_records() -> None:
    record = Kept((ERROR.message, Message("P-RUN", {"folder": "r"})), Message("P-RUN", {"folder": "r"}))
    encoded = records.encode(record)
    assert records.decode(encoded, Kept) == record
    data = json.loads(encoded)
    data["record"]["steps"] = ["a finished sentence"]
    assert records.decode(records.canonical(data), Kept).steps == (Message.stored("a finished sentence"),)
    data["record"]["steps"] = [{"code": 3}]
    with pytest.raises(CorruptRecord, match="steps"):
        records.decode(records.canonical(data), Kept)


def test_words_are_the_english_of_a_message() -> None:
    assert words("P-RUN", folder="r") == render(Message("P-RUN", {"folder": "r"}))
