"""Rows of a counter to samples: units, times, wraps, gaps, restarts and doubtful rows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ConfigError, RemoteProtocolError, UnsupportedDevice
from drivers.types.sensing import SampleBlock
from drivers.umd.codec import CODE, DATA, PHASE, SEQUENCE, UmdLines
from drivers.umd.counting import LEARN_MOVING, SequenceOrder, UmdCounting, ticks_forward
from drivers.umd.settings import UmdSettings

LAMBDA_NM = 632.990577


def rows_of(counts: np.ndarray, first: int = 0, *, velocity: bool = True) -> np.ndarray:
    """Lines as a one-axis uMD2 prints them, low-speed codes and all."""
    rows = np.zeros((len(counts), 8), np.int64)
    rows[:, 2] = counts
    rows[:, 3] = np.diff(counts, prepend=counts[:1]) if velocity else 0
    rows[:, SEQUENCE] = first + np.arange(len(counts))
    slot = rows[:, SEQUENCE] % 32
    facts = {1: (10, 126), 2: (8, 100_000), 3: (3, 2034), 4: (4, 2020), 5: (5, 99_039), 6: (6, 469), 13: (20, 1025)}
    for at, (code, data) in facts.items():
        rows[slot == at, CODE], rows[slot == at, DATA] = code, data
    return rows


def counting(**keys: object) -> UmdCounting:
    return UmdCounting(UmdSettings.read(keys, "laser"), "laser")


def ready(**keys: object) -> UmdCounting:
    """A counting that has heard two rounds of codes at standstill."""
    fresh = counting(**keys)
    fresh.take(UmdLines(rows_of(np.zeros(64, np.int64))))
    assert not fresh.missing
    return fresh


def joined(blocks: list[SampleBlock]) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    time_s = np.concatenate([block.time_s for block in blocks])
    values = np.concatenate([block.values[:, 0] for block in blocks])
    valid = np.concatenate([block.valid for block in blocks])
    return time_s, values, valid, sum(block.lost for block in blocks)


def test_one_count_is_an_eighth_of_the_vacuum_wavelength() -> None:
    counter = ready()
    counts = np.array([0, 1, 8_000, -8_000])
    _time, values, valid, _lost = joined(counter.take(UmdLines(rows_of(counts, 64))))
    assert values == pytest.approx(counts * LAMBDA_NM / 8 * 1e-6, abs=1e-12)
    assert values[2] == pytest.approx(0.632990577, abs=1e-12)
    assert valid.all()


@pytest.mark.parametrize(
    ("keys", "mm"),
    [
        ({"counts_per_cycle": 16}, LAMBDA_NM / 32 * 1e-6),
        ({"wavelength_nm": 633.0}, 633.0 / 8 * 1e-6),
        ({"count_size_nm": 10.0, "compensated_for": "air"}, 1e-5),
        ({"count_size_nm": 10, "compensated_for": "nothing", "counts_per_cycle": 16}, 1e-5),
    ],
)
def test_settings_set_the_size_of_a_count(keys: dict[str, object], mm: float) -> None:
    counter = ready(**keys)
    assert joined(counter.take(UmdLines(rows_of(np.array([1000]), 64))))[1][0] == pytest.approx(1000 * mm, rel=1e-12)


@pytest.mark.parametrize(("factor", "degrees"), [(1.0, 1.0), (1.0, -9.0), (1.002, 5.0)])
def test_angular_optics_make_the_arcsine_of_the_path_difference(factor: float, degrees: float) -> None:
    """dL = S sin(theta), S the distance of the reflectors, dL in air (the maker's paper on rotary calibration)."""
    counter = ready(optics_spacing_mm=30.0, optics_factor=factor)
    difference_mm = 30.0 * factor * math.sin(math.radians(degrees))
    counts = np.array([round(difference_mm * 1.00027 / (LAMBDA_NM / 8 * 1e-6))])
    (block,) = counter.take(UmdLines(rows_of(np.append([0], counts), 64, velocity=False)))
    assert block.channels == ("angle_arcsec",)
    assert block.values[-1, 0] == pytest.approx(3600.0 * degrees, abs=0.6)


def test_a_path_that_no_angle_makes_is_no_reading() -> None:
    counter = ready(optics_spacing_mm=30.0, max_speed_mm_s=1e9)
    (block,) = counter.take(UmdLines(rows_of(np.array([0, 400_000]), 64, velocity=False)))
    assert block.valid.tolist() == [True, False]
    assert "beyond the optics" in str(block.events[0])


@pytest.mark.parametrize(
    ("keys", "code"),
    [
        ({"wavelenght_nm": 633.0}, "E-CFG-SETTING"),
        ({"wavelength_nm": "633"}, "E-CFG-SETTING-VALUE"),
        ({"wavelength_nm": float("nan")}, "E-CFG-SETTING-VALUE"),
        ({"axis": 4}, "E-CFG-SETTING-VALUE"),
        ({"axis": True}, "E-CFG-SETTING-VALUE"),
        ({"compensated_for": "air"}, "E-CFG-SETTING-VALUE"),
        ({"count_size_nm": 10.0}, "E-CFG-SETTING-VALUE"),
        ({"count_size_nm": -1.0}, "E-CFG-SETTING-VALUE"),
        ({"optics_factor": 1.01}, "E-CFG-SETTING-VALUE"),
        ({"optics_spacing_mm": -30.0}, "E-CFG-SETTING-VALUE"),
    ],
)
def test_wrong_settings_are_refused(keys: dict[str, object], code: str) -> None:
    with pytest.raises(ConfigError) as caught:
        counting(**keys)
    assert caught.value.code == code


def test_nothing_is_a_sample_before_the_counter_has_said_its_size_twice() -> None:
    counter = counting()
    assert counter.missing == (8, 20)
    assert counter.take(UmdLines(rows_of(np.zeros(32, np.int64)))) == []
    assert counter.missing == (8, 20)
    counter.take(UmdLines(rows_of(np.zeros(14, np.int64), 32)))
    assert counter.missing == ()
    assert counter.low_speed.firmware == "1.26"
    assert (counter.sample_rate_hz, counter.counts_per_cycle, counter.low_speed.axes) == (1000.0, 4, 1)


def test_a_code_that_changes_for_good_is_an_error_and_one_flipped_bit_is_not() -> None:
    counter = ready()
    bent = rows_of(np.zeros(32, np.int64), 64)
    bent[2, DATA] ^= 1 << 7
    counter.take(UmdLines(bent))
    assert counter.sample_rate_hz == 1000.0
    changed = rows_of(np.zeros(64, np.int64), 96)
    changed[changed[:, CODE] == 8, DATA] = 61_035
    with pytest.raises(RemoteProtocolError) as caught:
        counter.take(UmdLines(changed))
    assert caught.value.code == "E-UMD-CHANGED"


def test_time_is_the_sequence_number_over_the_sample_frequency() -> None:
    counter = ready()
    time_s, *_rest = joined(counter.take(UmdLines(rows_of(np.zeros(3, np.int64), 64))))
    assert time_s.tolist() == [0.064, 0.065, 0.066]


def test_a_gap_cuts_the_block_and_counts_what_was_lost() -> None:
    counter = ready()
    rows = np.delete(rows_of(np.arange(100), 64), [0, 10, 11, 12, 50], axis=0)
    blocks = counter.take(UmdLines(rows))
    assert [block.lost for block in blocks] == [1, 3, 1]
    assert [len(block) for block in blocks] == [9, 37, 49]
    time_s, values, valid, _lost = joined(blocks)
    assert values == pytest.approx((time_s * 1000 - 64) * LAMBDA_NM / 8 * 1e-6, abs=1e-9)
    assert valid.all()


def test_fault_37_repeats_and_late_rows_are_dropped() -> None:
    counter = ready()
    rows = rows_of(np.arange(10), 64)
    blocks = counter.take(UmdLines(rows[[0, 1, 1, 2, 0, 3, 4]]))
    assert joined(blocks)[0].tolist() == [0.064, 0.065, 0.066, 0.067, 0.068]
    assert counter.repeats == 2


@pytest.mark.parametrize(("last", "number", "step"), [
    (5, 6, 1), (5, 5, 0), (5, 2, -3), (32767, -32768, 1), (32766, -32767, 3), (-1, 0, 1),
    (2**32 - 1, 0, 1), (2**31 - 1, -(2**31), 1), (100_000, 5, -99_995), (5, 2**40, 2**40 - 5),
])  # fmt: skip
def test_wraps_are_told_from_restarts(last: int, number: int, step: int) -> None:
    assert ticks_forward(last, number) == step


def test_fault_32_a_sixteen_bit_sequence_goes_on_over_its_wrap() -> None:
    counter = ready(sample_rate_hz=244.140625)
    numbers = (np.arange(64, 70_000) + 32768) % 65536 - 32768
    rows = rows_of(np.zeros(len(numbers), np.int64))
    rows[:, CODE] = 0
    rows[:, SEQUENCE] = numbers
    time_s, _values, valid, lost = joined(counter.take(UmdLines(rows)))
    assert lost == 0
    assert valid.all()
    assert time_s == pytest.approx(np.arange(64, 70_000) / 244.140625)


def test_fault_32_displacement_goes_on_over_its_32_bit_wrap() -> None:
    counter = counting(sample_rate_hz=1000.0, counts_per_cycle=4)
    true = np.arange(2**31 - 50, 2**31 + 50)
    rows = rows_of(true, velocity=False)
    rows[:, 2] = (true + 2**31) % 2**32 - 2**31
    _time, values, valid, _lost = joined(counter.take(UmdLines(rows)))
    assert values == pytest.approx(true * LAMBDA_NM / 8 * 1e-6, rel=1e-12)
    assert valid.all()


def test_fault_28_a_restart_marks_its_sample_and_time_goes_on() -> None:
    counter = ready()
    counter.take(UmdLines(rows_of(np.full(10_000, 77), 64)))
    blocks = counter.take(UmdLines(rows_of(np.zeros(10, np.int64), 0)))
    time_s, _values, valid, lost = joined(blocks)
    assert valid.tolist() == [False] + [True] * 9
    assert (np.diff(time_s) > 0).all()
    assert time_s[0] == pytest.approx(10.064)
    assert lost == 0
    assert "counter restarted" in str(blocks[0].events[0])


def test_a_lone_absurd_sequence_number_goes_with_its_row() -> None:
    counter = ready()
    rows = rows_of(np.arange(8), 64)
    rows[2, SEQUENCE] += 1 << 25
    rows[5, SEQUENCE] = 3
    blocks = counter.take(UmdLines(rows))
    assert joined(blocks)[0].tolist() == [0.064, 0.065, 0.067, 0.068, 0.070, 0.071]
    assert joined(blocks)[3] == 2
    assert "2 damaged lines" in str(blocks[0].events[0])


@given(st.integers(0, 40), st.integers(0, 40), st.lists(st.integers(1, 30), max_size=12))
@settings(max_examples=100, deadline=None)
def test_the_order_of_rows_does_not_depend_on_how_they_were_cut(gap: int, restart: int, cuts: list[int]) -> None:
    numbers = np.concatenate((np.arange(100, 140), np.arange(140 + gap, 180), np.arange(restart, 60), [59, 10**9]))
    rows = np.zeros((len(numbers), 8), np.int64)
    rows[:, SEQUENCE] = numbers
    whole = SequenceOrder().sort(rows)
    order, found, at = SequenceOrder(), [], 0
    for cut in [*cuts, len(rows)]:
        found.append(order.sort(rows[at : at + cut]))
        at += cut
    assert np.array_equal(np.concatenate([part.rows for part in found]), whole.rows)
    assert np.array_equal(np.concatenate([part.steps for part in found]), whole.steps)


def test_phase_errors_are_marked_and_negative_phases_are_not() -> None:
    counter = ready()
    rows = rows_of(np.zeros(6, np.int64), 64)
    rows[:, PHASE[0]] = [0, 100, -100, 0x200, 0x4000, 0x1FF]
    blocks = counter.take(UmdLines(rows))
    assert joined(blocks)[2].tolist() == [True, True, True, False, False, True]
    assert [*map(str, blocks[0].events)] == ["phase error at 0.067000 s"]


def test_a_step_that_no_axis_can_make_is_marked() -> None:
    counter = ready()
    counts = np.array([0, 0, 60_000, 0, 0])
    assert joined(counter.take(UmdLines(rows_of(counts, 64, velocity=False))))[2].tolist() == [
        True, True, False, False, True,
    ]  # fmt: skip


@pytest.mark.parametrize("bit", range(32))
def test_fault_05_a_flipped_bit_in_a_count_is_found_by_the_velocity_beside_it(bit: int) -> None:
    counter = ready()
    counts = 3 * np.arange(1, LEARN_MOVING + 111)
    rows = rows_of(counts, 64)
    rows[0, 3] = 3
    rows[-50, 2] ^= 1 << bit
    blocks = counter.take(UmdLines(rows))
    valid = joined(blocks)[2]
    assert not valid[-50]
    assert valid.sum() == len(valid) - 2
    assert "disagree" in str(blocks[0].events[-1])


@pytest.mark.parametrize("velocity", [0, 5])
def test_a_counter_whose_velocity_is_something_else_is_not_held_to_it(velocity: int) -> None:
    counter = ready()
    rows = rows_of(np.cumsum(np.full(3 * LEARN_MOVING, 3)), 64)
    rows[:, 3] = velocity
    assert joined(counter.take(UmdLines(rows)))[2].all()


def test_fault_25_ambient_is_as_old_as_its_oldest_reading() -> None:
    counter = ready()
    ambient = counter.ambient()
    assert (ambient.air_degc, ambient.pressure_hpa, ambient.humidity_pct) == (20.34, 990.39, 46.9)
    assert ambient.material_degc == (20.2,)
    assert ambient.age_s == pytest.approx(0.028)
    silent = rows_of(np.zeros(1000, np.int64), 64)
    silent[:, CODE] = 0
    counter.take(UmdLines(silent))
    assert counter.ambient().age_s == pytest.approx(1.028)


def test_no_sensor_is_none_and_not_twenty_degrees() -> None:
    bare = counting()
    rows = rows_of(np.zeros(64, np.int64))
    rows[np.isin(rows[:, CODE], (3, 4)), CODE] = 0
    rows[rows[:, CODE] == 5, DATA] = 0
    bare.take(UmdLines(rows))
    ambient = bare.ambient()
    assert (ambient.air_degc, ambient.pressure_hpa, ambient.material_degc) == (None, None, ())


def test_an_axis_the_counter_does_not_have_is_refused() -> None:
    with pytest.raises(UnsupportedDevice) as caught:
        ready(axis=2)
    assert caught.value.code == "E-UMD-AXIS"


def test_the_second_axis_is_read_from_its_own_columns() -> None:
    counter = counting(axis=2)
    wide = np.zeros((66, 16), np.int64)
    wide[:, :8] = rows_of(np.full(66, 9))
    wide[:, 9] = np.arange(66) * 4
    wide[:, 10] = 4
    counter.take(UmdLines(wide[:64]))
    values = joined(counter.take(UmdLines(wide[64:])))[1]
    assert values == pytest.approx(np.array([256, 260]) * LAMBDA_NM / 8 * 1e-6)


def test_lines_that_are_numbered_backwards_are_refused_and_a_block_that_comes_twice_is_not() -> None:
    counter = ready()
    block = rows_of(np.zeros(40, np.int64), 64)
    counter.take(UmdLines(block))
    counter.take(UmdLines(block))
    assert counter.repeats == 40
    back = rows_of(np.zeros(40, np.int64), 104)
    back[:, SEQUENCE] = back[::-1, SEQUENCE]
    with pytest.raises(RemoteProtocolError) as caught:
        counter.take(UmdLines(back))
    assert (caught.value.code, caught.value.fields["lines"]) == ("E-UMD-BACKWARDS", 39)
