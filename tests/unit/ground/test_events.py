"""Events: each fills its own text, survives a lease and a log as a word of progress, and is told apart by its class."""

from __future__ import annotations

import json
import re
from dataclasses import fields

import pytest

from drivers.errors import catalogue, words
from drivers.message import Message, fields_as_data, fields_from_data
from gateway.audience import KINDS, MOVE, Audience, kind_of
from gateway.events import EVENTS, Event, PushPhaseChanged, RunStarted, received

TERM = "term_"


@pytest.mark.parametrize("kind", EVENTS.values(), ids=lambda kind: kind.__name__)
def test_an_event_fills_its_text_and_comes_back_as_what_it_was(kind: type[Event]) -> None:
    asked = set(re.findall(r"\{(\w+)", catalogue()[kind.code]["what"]))
    assert {name for name in asked if not name.startswith(TERM)} <= {one.name for one in fields(kind)}
    made = kind()
    told: list[tuple[str, dict[str, object]]] = []
    made.tell(lambda code, /, **given: told.append((code, given)))
    ((code, given),) = told
    assert received(code, given) == made
    assert "<" not in words(code, **given)
    over_the_wire = fields_from_data(json.loads(json.dumps(fields_as_data(given))))
    assert received(code, over_the_wire) == made


def test_a_message_within_an_event_passes_a_lease() -> None:
    event = PushPhaseChanged("X1", "BACKUP", Message.of("W-STEP-BACKUP"))
    sent = json.loads(json.dumps(fields_as_data(event.told_fields)))
    assert received(event.code, fields_from_data(sent)) == event


def test_text_for_people_alone_is_no_event() -> None:
    assert received("P-LEFT", {"words": "a program"}) is None
    started = received("P-RUN", {"folder": "/runs/20260102-hall", "more": 1})
    assert isinstance(started, RunStarted)
    assert started.run_id == "20260102-hall"


def test_every_word_about_motion_is_named_as_one() -> None:
    named = {code for code in catalogue() if code.startswith("P-MOVE-")}
    assert set(MOVE) == named
    assert {code for code, kind in KINDS.items() if kind is Audience.MOVE} == named
    assert kind_of("P-MOVE-TO") is Audience.MOVE
