"""The acting measuring system: told by the control, compared with the site file, refused where it is another or two."""

from __future__ import annotations

import pytest

from drivers.errors import UnsupportedDevice
from drivers.sinumerik.opcua.machine import Encoders, check_encoder, encoder_names, encoders_from_values


@pytest.mark.parametrize(
    ("values", "encoder"),
    [
        ([2, 0, 1, 0, 25], 1),  # measuring system 2 acts, as on most machines with scales
        ([1, 1, 0, 81, 0], 0),
        ([1, 1, 1, 81, 81], 0),  # the second is not there, whatever its switch says
        ([2, 0, 0, 0, 25], 1),  # none is on yet, one has memory
        ([2, 0, 0, 81, 81], 0),  # none is on, both have memory: the site file decides
        ([2, 0, 0, 81, 81], 1),
        ([None, None, None, None, None], 0),  # nothing can be read: memory is asked for elsewhere
    ],
)
def test_the_encoder_that_acts_is_taken(values: list[float | None], encoder: int) -> None:
    check_encoder(encoders_from_values(values), "X1", encoder, "840D")


@pytest.mark.parametrize(
    ("values", "encoder", "code"),
    [
        ([2, 0, 1, 0, 25], 0, "E-NC-ENCODER"),
        ([2, 1, 0, 81, 25], 1, "E-NC-ENCODER"),
        ([1, 0, 0, 81, 0], 1, "E-NC-ENCODER"),
        ([2, 0, 0, 0, 25], 0, "E-NC-ENCODER"),
        ([2, 0, 0, 0, 0], 0, "E-NC-ENCODER"),
        ([2, 1, 1, 25, 25], 0, "E-NC-ENCODERS"),
        ([2, 1, 1, 25, 25], 1, "E-NC-ENCODERS"),
    ],
)
def test_another_one_or_two_are_refused_with_what_the_control_says(
    values: list[float | None], encoder: int, code: str
) -> None:
    with pytest.raises(UnsupportedDevice) as caught:
        check_encoder(encoders_from_values(values), "X1", encoder, "840D")
    assert caught.value.code == code
    assert f"MD38000[0], [1] = {values[3]}, {values[4]}" in caught.value.what


def test_what_is_read() -> None:
    names = encoder_names("Z1")
    assert len(names) == 5
    assert names[2] == "$MA_ENC_COMP_ENABLE[1,Z1]"
    assert encoders_from_values([2, 1, 0, 30, None]) == Encoders(2, (True, False), (30, None))


@pytest.mark.parametrize("values", [[2.0, 0.0, 0.0, 101.0, 25.0], [None, None, None, None, None]])
def test_no_default_decides_between_two_that_may_act(values: list[float | None]) -> None:
    with pytest.raises(UnsupportedDevice) as caught:
        check_encoder(encoders_from_values(values), "X1", 0, "840D", said=False)
    assert caught.value.code == "E-NC-ENCODER-OPEN"
    check_encoder(encoders_from_values(values), "X1", 0, "840D")


def test_a_default_is_fine_where_only_one_can_act() -> None:
    check_encoder(encoders_from_values([2.0, 0.0, 0.0, 101.0, 0.0]), "X1", 0, "840D", said=False)
    check_encoder(encoders_from_values([2.0, 1.0, 0.0, 101.0, 25.0]), "X1", 0, "840D", said=False)
