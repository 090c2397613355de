"""What a server may give for a variable, and what is refused with its name, its value and what it must be."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest

from drivers.errors import RemoteProtocolError
from drivers.sinumerik.opcua.session import nodes

NUMBER = nodes.r_parameter(90)
BLOCK = nodes.r_block(90, 3)
STATUS = nodes.in_channel("chanStatus")
ALARM = nodes.alarm_number(1)
MESSAGE = nodes.in_channel("msg", 1, "ProgramInfo")
SWITCH = nodes.to_path("$MA_ENC_COMP_ENABLE[0,X1]", ("X1",)) or ""
UNIT = nodes.BASIC_LENGTH_UNIT
LEVEL = nodes.ACCESS_LEVEL
FILE = "Sinumerik/FileSystem/Part Program/A.MPF"
SPECIAL: tuple[Any, ...] = (
    float("nan"), float("inf"), float("-inf"), 10**400, -(10**400), 10**5000, [1.0], [], "1", "", b"1", b"", {}, (1,),
    {1}, 1j, object(), datetime(2026, 1, 1, tzinfo=UTC),
)  # fmt: skip
GOOD: dict[str, tuple[tuple[Any, Any], ...]] = {
    NUMBER: ((1.5, 1.5), (2, 2.0), (-1e300, -1e300)),
    BLOCK: (([1.0, 2, 3.5], [1.0, 2.0, 3.5]),),
    STATUS: ((2, 2), (2.0, 2), (0xFFFF, 0xFFFF)),
    ALARM: ((0, 0), (0xFFFFFFFF, 0xFFFFFFFF)),
    MESSAGE: (("text", "text"), (None, ""), ("", "")),
    SWITCH: ((True, True), (False, False), (1, True), (0.0, False)),
    UNIT: ((0, 0), (1, 1)),
    LEVEL: ((0, 0), (7, 7)),
    f"{FILE}.UserWritable": ((False, False),),
    f"{FILE}.Size": ((2**40, 2**40),),
}
BAD: dict[str, tuple[Any, ...]] = {
    NUMBER: (None, True, False),
    BLOCK: (None, 1.0, [1.0, 2.0], [1.0, 2.0, 3.0, 4.0], [1.0, float("nan"), 3.0], [1.0, None, 3.0], [[1.0], 2.0, 3.0]),
    STATUS: (None, True, -1, 2.5, 0x10000),
    ALARM: (None, False, -1, 0.5, 2**32),
    MESSAGE: (True, 0, 1.5),
    SWITCH: (None, 2, -1, 0.5),
    UNIT: (None, 2, True),
    LEVEL: (None, 8, -1),
    f"{FILE}.UserWritable": (None, 2),
    f"{FILE}.Size": (None, -1, True),
}


@pytest.mark.parametrize("path", GOOD)
def test_what_a_variable_can_hold_comes_as_plain_python(path: str) -> None:
    for given, wanted in GOOD[path]:
        found = nodes.check_value(path, given, "840D")
        assert found == wanted
        assert type(found) is type(wanted)


@pytest.mark.parametrize("path", BAD)
def test_all_else_is_refused_by_name_value_and_kind(path: str) -> None:
    texts = ("1", "") if path == MESSAGE else ()
    for given in (*BAD[path], *(one for one in SPECIAL if one not in texts)):
        with pytest.raises(RemoteProtocolError) as caught:
            nodes.check_value(path, given, "840D")
        error = caught.value
        assert error.code == "E-UA-VALUE"
        assert path in str(error.fields["what"])
        assert error.fields["wanted"]
        assert 0 < len(str(error.fields["value"])) <= nodes.SHOWN
        assert "<" not in error.what.replace("<object", "")


@pytest.mark.parametrize("given", [None, float("nan"), float("inf"), 0, -1.0, "60000", True, [60000.0]])
def test_a_lifetime_that_is_none_is_refused(given: Any) -> None:
    with pytest.raises(RemoteProtocolError, match="E-UA-VALUE"):
        nodes.check_duration(given, "the session's timeout", "840D")


def test_times_bytes_outputs_and_labels() -> None:
    moment = datetime(2026, 1, 1, tzinfo=UTC)
    assert nodes.check_duration(60000, "the session's timeout", "840D") == 60.0
    assert nodes.check_time(moment, "clock", "840D") == moment.replace(tzinfo=None)
    assert nodes.check_time(None, "clock", "840D") is None
    assert nodes.check_label(4.8, "version", "840D") == "4.8"
    assert nodes.check_label(" V4.8 ", "version", "840D") == "V4.8"
    assert nodes.check_content(b"", "file", "840D") == b""
    assert nodes.method_output([0], 0, "Select", "840D") == 0
    for check, given in ((nodes.check_time, 1.0), (nodes.check_label, True), (nodes.check_content, "text")):
        with pytest.raises(RemoteProtocolError, match="E-UA-VALUE"):
            check(given, "it", "840D")
    with pytest.raises(RemoteProtocolError, match="1 outputs"):
        nodes.method_output([], 0, "Select", "840D")
