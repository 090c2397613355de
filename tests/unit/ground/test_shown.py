"""Units as people read and type them: µm and °C in texts, um and degC in keys and programs."""

from __future__ import annotations

import pytest

from drivers.errors import TrueflankError, words
from drivers.terms import shown
from drivers.units import typed_unit


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("3 um", "3 µm"),
        ("0.2 um/mm, at 20 degC.", "0.2 µm/mm, at 20 °C."),
        ("(um)", "(µm)"),
        ("um or arcsec", "µm or arcsec"),
        ("--x-um 3 and deviation_um stay", "--x-um 3 and deviation_um stay"),
        ("'um', \"um\", `um` and `mm, um, inch` stay", "'um', \"um\", `um` and `mm, um, inch` stay"),
        ("um.csv, minimum, value=um", "um.csv, minimum, value=um"),
        ("3 µm", "3 µm"),
    ],
)
def test_units_are_shown_as_people_write_them(text: str, wanted: str) -> None:
    assert shown(text) == wanted


def test_every_text_of_the_catalogue_goes_that_way() -> None:
    told = words("S-TOOTH-GAIN", gain="0.9", U="0.2")
    assert "0.9 µm" in told
    assert " um" not in told
    error = TrueflankError("E-INT-VALUE", table="X1", value=250.0, unit="um", limit=200.0)
    assert "250.0 µm" in error.what
    assert error.as_record()["fields"] == {"table": "X1", "value": "250.0", "unit": "um", "limit": "200.0"}


def test_a_typed_unit_is_understood_with_either_letter() -> None:
    assert [typed_unit(one) for one in ("um", "\N{MICRO SIGN}m", "\N{GREEK SMALL LETTER MU}m", "mm")] == ["um"] * 3 + [
        "mm"
    ]
