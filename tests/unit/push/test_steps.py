"""Every step that a push writes into its journal has words for people, and no name in capitals reaches them."""

from __future__ import annotations

from gateway.push.phases import STEP_CODES, PushEvent, step_message


def test_every_kind_of_a_journal_has_words_without_capitals() -> None:
    assert set(STEP_CODES) == set(PushEvent)
    assert [kind for kind in PushEvent if str(step_message(kind)).isupper()] == []


def test_a_kind_of_another_version_is_told_in_plain_letters() -> None:
    assert str(step_message("NEVER_HEARD_OF")) == "never heard of"
