"""Whose turn it is, by hand: reports in, turns out; time moves only when nobody has anything left to do."""

from __future__ import annotations

from math import inf

import pytest

from drivers.clock.turns import (
    CountedEnd,
    Mark,
    Turn,
    TurnReport,
    Turns,
    decode_report,
    decode_request,
    decode_turn,
    encode_report,
    encode_request,
    encode_turn,
)

OPENED, ENDED, CLOSED, HELD = Mark.OPENED, Mark.ENDED, Mark.CLOSED, Mark.HELD


def two(first: float = inf, second: float = inf) -> Turns:
    """Two members that wait for these timers."""
    turns = Turns()
    for due in (first, second):
        number = turns.join()
        assert turns.next() == Turn(number, 1, 0.0, -inf if number == 0 and turns.wanted else turns.alone_until)
        turns.yielded(number, TurnReport(0.0, due))
    return turns


def joined(taken: CountedEnd, called: CountedEnd, **dues: float) -> Turns:
    """Two members, connected: member 1 called 0 at its port 80 from 9000."""
    turns = two()
    turns.want(0, 1)
    turns.next()
    turns.yielded(0, TurnReport(0.0, dues.get("first", inf), ports=((80, True),)))
    turns.want(1, 1)
    turns.next()
    turns.yielded(1, TurnReport(0.0, dues.get("second", inf), (called,)))
    given = turns.next()
    assert given is not None
    assert (given.number, given.promised) == (0, (((80, 9000), called.sent),))
    turns.yielded(0, TurnReport(0.0, dues.get("first", inf), (taken,)))
    return turns


def test_timers_go_by_time_then_by_number_and_each_knows_how_far_it_may_go_alone() -> None:
    turns = two(5.0, 3.0)
    assert turns.next() == Turn(1, 2, 3.0, 5.0)
    assert turns.next() is None  # one at a time
    turns.yielded(1, TurnReport(4.5, 5.0))
    assert turns.next() == Turn(0, 2, 5.0, 5.0)
    turns.yielded(0, TurnReport(5.0, 9.0))
    assert turns.next() == Turn(1, 3, 5.0, 9.0)


def test_nobody_goes_on_before_what_the_limit_allows() -> None:
    turns = two(5.0, 6.0)
    assert turns.next(allowed=4.9) is None
    assert turns.now == 0.0
    assert turns.next(allowed=5.0) == Turn(0, 2, 5.0, 5.0)


def test_news_from_outside_come_at_the_time_it_is_and_old_wishes_are_void() -> None:
    turns = two(5.0, 6.0)
    turns.want(1, 1)
    turns.want(1, 0)
    assert turns.next(allowed=3.0) == Turn(1, 2, 3.0, 3.0)
    turns.want(0, 0)
    assert not turns.wanted
    turns.yielded(1, TurnReport(3.0, 6.0))
    turns.want(0, 1)
    assert turns.next() == Turn(0, 2, 3.0, 6.0)  # without a limit time stands


def test_time_stands_while_bytes_are_on_their_way_and_their_reader_is_next() -> None:
    turns = joined(CountedEnd((80, 9000), 0, 4, OPENED), CountedEnd((9000, 80), 4, 0, OPENED), first=2.0, second=1.0)
    assert turns.next() == Turn(1, 3, 1.0, 2.0)
    turns.yielded(1, TurnReport(1.5, inf, (CountedEnd((9000, 80), 10),)))
    assert turns.next() == Turn(0, 4, 1.5, inf, (((80, 9000), 10),))
    # It read a part and went away: the rest is still on its way.
    turns.yielded(0, TurnReport(1.5, 2.0, (CountedEnd((80, 9000), 7, 8),)))
    assert (turns.settled, turns.now) == (False, 1.5)
    assert turns.next() == Turn(0, 5, 1.5, inf)
    turns.yielded(0, TurnReport(1.5, 2.0, (CountedEnd((80, 9000), 7, 10),)))
    assert turns.next() == Turn(1, 4, 1.5, 2.0, (((9000, 80), 7),))


@pytest.mark.parametrize("mark", [HELD, ENDED, ENDED | CLOSED])
def test_who_does_not_read_is_not_waited_for(mark: Mark) -> None:
    turns = joined(CountedEnd((80, 9000), 0, 1, OPENED | mark), CountedEnd((9000, 80), 4, 0, OPENED), first=2.0)
    assert turns.next() == Turn(0, 4, 2.0, inf, (((80, 9000), 4),))


def test_a_writer_without_room_goes_on_once_the_other_has_read() -> None:
    turns = joined(
        CountedEnd((80, 9000), 0, 4, OPENED | HELD), CountedEnd((9000, 80), 9, 0, OPENED | Mark.STUCK), first=2.0
    )
    assert turns.next() == Turn(1, 3, 0.0, 2.0)
    turns.yielded(1, TurnReport(0.0, inf, (CountedEnd((9000, 80), 9, 0, Mark.STUCK),)))
    assert turns.next() == Turn(0, 4, 2.0, inf, (((80, 9000), 9),))


def test_a_call_is_on_its_way_until_it_is_taken_or_nobody_listens() -> None:
    turns = two(2.0)
    turns.next()
    turns.yielded(0, TurnReport(2.0, 5.0, ports=((80, True),)))
    turns.want(1, 1)
    turns.next()
    turns.yielded(
        1, TurnReport(2.0, inf, (CountedEnd((9000, 80), 0, 0, OPENED), CountedEnd((9001, 443), 7, 0, OPENED)))
    )
    assert turns.next() == Turn(0, 3, 2.0, inf, (((80, 9000), 0),))  # 443 is a stranger's
    turns.yielded(0, TurnReport(2.0, 5.0, ports=((80, False),)))
    assert turns.next() == Turn(0, 4, 5.0, inf)


def test_the_same_two_ports_may_be_joined_again() -> None:
    turns = joined(CountedEnd((80, 9000), 0, 0, OPENED), CountedEnd((9000, 80), 0, 0, OPENED), first=2.0, second=1.0)
    for count in (3, 5):
        assert turns.next() == Turn(1, count, turns.now, turns.alone_until)
        turns.yielded(1, TurnReport(turns.now, 1.0, (CountedEnd((9000, 80), 1, 0, CLOSED),)))
        assert turns.next() == Turn(0, count + 1, turns.now, turns.alone_until, (((80, 9000), 1),))
        turns.yielded(0, TurnReport(turns.now, 2.0, (CountedEnd((80, 9000), 1, 1, ENDED | CLOSED),)))
        turns.next()
        turns.yielded(1, TurnReport(turns.now, 1.0, (CountedEnd((9000, 80), 0, 0, OPENED),)))
        assert turns.next() == Turn(0, count + 2, turns.now, turns.alone_until, (((80, 9000), 0),))
        turns.yielded(0, TurnReport(turns.now, 2.0, (CountedEnd((80, 9000), 0, 0, OPENED),)))


def test_who_dies_is_waited_for_no_longer_and_who_was_connected_hears_of_it() -> None:
    turns = joined(CountedEnd((80, 9000), 0, 4, OPENED), CountedEnd((9000, 80), 4, 0, OPENED), first=2.0, second=1.0)
    turns.next()
    assert turns.holder == 1
    turns.leave(1)
    assert turns.next() == Turn(0, 4, 1.0, inf, (((80, 9000), 5),))
    turns.yielded(0, TurnReport(1.0, 2.0, (CountedEnd((80, 9000), 1, 5, ENDED | CLOSED),)))
    assert turns.next() == Turn(0, 5, 2.0, inf)
    with pytest.raises(ValueError, match="no turn"):
        turns.yielded(1, TurnReport(2.0))


def test_who_joins_comes_in_at_the_time_it_is() -> None:
    turns = two(5.0, 7.0)
    turns.next()
    turns.yielded(0, TurnReport(6.0, inf))
    assert turns.join() == 2
    assert turns.next() == Turn(2, 1, 6.0, 7.0)


def test_messages_arrive_as_they_were_sent() -> None:
    turn = Turn(3, 7, 1.25, inf, (((80, 9000), 5), ((1, 65535), 1 << 40)))
    told = TurnReport(
        1.5, inf, (CountedEnd((9000, 80), 5, 6, OPENED | ENDED),), ((80, True), (81, False)), uncounted=True
    )
    assert decode_turn(encode_turn(turn)) == turn
    assert decode_report(encode_report(told)) == told
    assert decode_request(encode_request(9)) == 9
    for read, data in ((decode_turn, b"x"), (decode_report, encode_report(told) + b"x"), (decode_request, b"")):
        with pytest.raises(ValueError, match=r"bytes|buffer"):
            read(data)
