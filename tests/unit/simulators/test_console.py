"""What a person types at a simulated machine reaches the judge as the order that is meant."""

from __future__ import annotations

import pytest

from simulators.cell.console import WORDS, parse_order
from simulators.cellfile import list_cells, load_cell, packaged_cells
from simulators.truth import Climate


@pytest.mark.parametrize(
    ("typed", "order"),
    [
        ("nc start", {"set": "press", "key": "NC START"}),
        ("  NCK   reset ", {"set": "press", "key": "NCK RESET"}),
        ("Auto Off", {"set": "operator", "options": {"auto": False}}),
        ("mount exx x1", {"set": "mount", "component": "EXX", "axis": "X1"}),
        ("break laser", {"set": "beam", "instrument": "laser", "broken": True}),
        ("clear laser", {"set": "beam", "instrument": "laser", "broken": False}),
        ("air 25.5", {"set": "weather", "air_degc": 25.5}),
        ("jog X1 -200", {"set": "jog", "axis": "X1", "value": -200.0}),
        ("take part", {"set": "unload_part"}),
    ],
)
def test_a_typed_line_is_an_order(typed: str, order: dict[str, object]) -> None:
    assert parse_order(typed) == order


def test_every_word_of_the_help_is_understood_and_nothing_else() -> None:
    for line in WORDS:
        for one in line.split(" | "):
            assert parse_order(one) is not None or one == "help", one
    assert parse_order("dance") is None
    assert parse_order("jog X1 far") is None


def test_the_weather_is_what_was_asked_for_and_drifts_on() -> None:
    climate = Climate(load_cell("demo").climate)
    climate.change(7200.0, air_degc=18.0)
    assert climate.true(7200.0).air_degc == pytest.approx(18.0)
    assert climate.true(10800.0).air_degc > 18.1
    assert climate.true(7200.0).pressure_hpa == Climate(load_cell("demo").climate).true(7200.0).pressure_hpa


def test_every_cell_that_comes_along_says_what_it_is() -> None:
    assert set(list_cells()) == set(packaged_cells())
    assert all(len(words) > 20 and "\n" not in words for words in list_cells().values())
