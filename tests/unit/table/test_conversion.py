"""Result files to tables: datum and directions, repetitions, grids, zero at the reference, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ConfigError, Gap, ValueOutOfRange
from drivers.types.results import MeasuredSet
from gateway.table.conversion import Conversion, FileDatum, TableRequest, convert, datum_of

UP, DOWN = (0.0, 2.0, 4.0, 3.0), (-1.0, 0.0, 2.0, 3.0)


def measured(up: tuple[float, ...] = UP, down: tuple[float, ...] = DOWN, unit: str = "mm") -> MeasuredSet:
    """Two repetitions, +/- 0.5 around the means, targets every 100 from the file's own zero."""
    spread = np.array([-0.5, 0.5])
    means = np.stack([up, down], axis=1)
    return MeasuredSet(100.0 * np.arange(len(up)), means[:, None, :] + spread[None, :, None], unit)  # type: ignore[arg-type]


def asked(to: str = "axis", **more: object) -> TableRequest:
    return TableRequest(**({"to": to, "axis": "X1", "reference": 100.0, "datum": FileDatum(0.0)} | more))  # type: ignore[arg-type]


def found(conversion: Conversion) -> str:
    return " ".join(str(one.message) for one in conversion.findings)


def test_eec_is_the_mean_of_both_directions_zero_at_the_reference() -> None:
    conversion = convert(measured(), asked(datum=FileDatum(50.0), reference=150.0))
    (table,) = conversion.tables
    assert (table.kind, table.minimum, table.maximum, table.step) == ("axis", 50.0, 350.0, 100.0)
    assert table.deviations == (-1.5, 0.0, 2.0, 2.0)
    assert "W-COMP-REVERSAL" in found(conversion)
    assert "(1.250 µm)" in found(conversion)
    assert "W-COMP-REPLACES" in found(conversion)


def test_cec_is_a_pair_with_its_sign_said_to_be_unproven() -> None:
    conversion = convert(measured(), asked("cross", index=4))
    plus, minus = conversion.tables
    assert (plus.direction, plus.index, plus.deviations) == (1, 4, (-2.0, 0.0, 2.0, 1.0))
    assert (minus.direction, minus.index, minus.deviations) == (-1, 5, (-1.0, 0.0, 2.0, 3.0))
    assert {plus.input_axis, plus.output_axis, minus.output_axis} == {"X1"}
    assert "W-COMP-CROSS-SIGN" in found(conversion)
    assert "the reversal at the reference 100 (2.000 µm)" in found(conversion)


def test_a_file_that_counts_against_the_machine() -> None:
    """machine = 300 - file: positions run back, deviations change sign, + in the file is - on the machine."""
    datum = datum_of([(0.0, 300.0), (300.0, 0.0)])
    assert datum == FileDatum(300.0, -1)
    plus, minus = convert(measured(), asked("cross", datum=datum, reference=0.0)).tables
    assert plus.deviations == (0.0, 1.0, 3.0, 4.0)  # -(DOWN) turned round, less its value at 0
    assert minus.deviations == (0.0, -1.0, 1.0, 3.0)
    (mean,) = convert(measured(), asked(datum=datum, reference=0.0)).tables
    assert mean.deviations == (0.0, 0.0, 2.0, 3.5)


@pytest.mark.parametrize(
    "pairs", [[(0.0, 1.0), (0.0, 2.0)], [(0.0, 0.0), (10.0, 11.0)], [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)]]
)
def test_datum_pairs_must_fit(pairs: list[tuple[float, float]]) -> None:
    with pytest.raises(ConfigError, match="E-COMP-DATUM"):
        datum_of(pairs)
    assert datum_of([(10.0, 60.0)]) == datum_of([(10.0, 60.0), (20.0, 70.0)]) == FileDatum(50.0)


def test_missing_repetitions_count_as_missing() -> None:
    one = measured()
    one.deviations[2, 0, 0] = np.nan
    (table,) = convert(one, asked()).tables
    assert table.deviations[2] == pytest.approx(2.25)  # 4.5 alone instead of the mean 4.0
    one.deviations[2, 1, 0] = np.nan
    with pytest.raises(Gap, match=r"E-COMP-MISSING.*target 200 mm.*direction \+"):
        convert(one, asked())


def test_one_direction_makes_eec_with_a_warning_and_no_pair() -> None:
    one = measured()
    one.deviations[:, :, 1] = np.nan
    conversion = convert(one, asked())
    assert conversion.tables[0].deviations == (-2.0, 0.0, 2.0, 1.0)
    assert "W-COMP-ONE-WAY" in found(conversion)
    with pytest.raises(Gap, match="E-COMP-ONE-WAY"):
        convert(one, asked("cross"))


def test_a_modulo_axis_closes_wherever_it_was_measured() -> None:
    """0 and 360 deg are one position; the datum turns the file round the circle."""
    wave = tuple(5.0 * np.sin(np.radians(angle)) for angle in range(0, 361, 30))
    spread = np.stack([wave, wave], axis=1)[:, None, :]
    turn = MeasuredSet(30.0 * np.arange(13), spread, "deg")
    (table,) = convert(turn, asked(modulo=True, datum=FileDatum(-90.0), reference=0.0)).tables
    assert (table.minimum, table.maximum, table.step, table.modulo) == (0.0, 360.0, 30.0, True)
    assert table.deviations[0] == table.deviations[-1] == 0.0
    expected = [5.0 * np.sin(np.radians(angle + 90.0)) - 5.0 for angle in range(0, 361, 30)]
    assert list(table.deviations) == pytest.approx(expected, abs=0.0019)  # half of 1e-6 deg
    with pytest.raises(Gap, match="E-COMP-TURN"):
        convert(measured(), asked(modulo=True))


def test_a_grid_of_ones_own() -> None:
    (table,) = convert(measured(), asked(minimum=50.0, maximum=250.0, step=50.0, reference=100.0)).tables
    assert len(table.deviations) == 5
    assert table.deviations[1] == 0.0
    for beyond in ({"minimum": -1.0}, {"maximum": 301.0}):
        with pytest.raises(Gap, match="E-COMP-REACH"):
            convert(measured(), asked(step=1.0, **beyond))
    with pytest.raises(Gap, match="E-COMP-GRID"):
        convert(measured(), asked(step=70.0))
    with pytest.raises(Gap, match="E-COMP-GRID"):
        convert(measured(), asked(step=0.001))


def test_uneven_targets_need_a_grid() -> None:
    uneven = measured()
    uneven.targets[1] = 90.0
    with pytest.raises(ConfigError, match="E-COMP-NO-GRID"):
        convert(uneven, asked())
    assert convert(uneven, asked(step=100.0)).tables[0].maximum == 300.0


def test_a_reference_outside_the_table_is_said() -> None:
    conversion = convert(measured(), asked(reference=900.0))
    assert conversion.tables[0].deviations[-1] == 0.0
    assert "W-COMP-OUTSIDE" in found(conversion)


def test_limits_hold_offline_too() -> None:
    with pytest.raises(ValueOutOfRange, match="E-COMP-VALUE"):
        convert(measured((0.0, 300.0, 0.0, 0.0), (0.0, 300.0, 0.0, 0.0)), asked(reference=0.0))
    with pytest.raises(ValueOutOfRange, match="E-COMP-SLOPE"):
        convert(measured((0.0, 110.0, 0.0, 0.0), (0.0, 110.0, 0.0, 0.0)), asked(reference=0.0))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-20.0, 20.0), min_size=3, max_size=12),
    st.integers(-300, 300),
    st.sampled_from([1, -1]),
    st.integers(0, 11),
)
def test_whatever_the_datum_the_table_is_the_mean_less_its_value_at_the_reference(
    means: list[float], offset: int, sense: int, place: int
) -> None:
    one = measured(tuple(means), tuple(means))
    datum = FileDatum(float(offset), 1 if sense == 1 else -1)
    place %= len(means)
    reference = datum.offset + datum.sense * one.targets[place]
    (table,) = convert(one, asked(datum=datum, reference=reference)).tables
    for target, mean in zip(one.targets, means, strict=True):
        at = np.array([datum.offset + sense * target])
        assert float(table.at(at)[0]) == pytest.approx(sense * (mean - means[place]), abs=0.00051)
    assert abs(float(table.at(np.array([reference]))[0])) < 1e-9
