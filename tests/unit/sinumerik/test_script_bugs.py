"""The bugs of public scripts: a file as each would write it is caught in the right words, and ours is without it."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.errors import FileFormatError
from drivers.sinumerik.tablefile import reader, writer
from drivers.sinumerik.tablefile.format import TableFiles
from drivers.tablefile import TableFile, TableMachine
from drivers.types.results import MeasuredSet
from gateway.evaluate.standards.iso230_2 import evaluate_iso230_2
from gateway.table.conversion import FileDatum, TableRequest, convert
from gateway.table.file_comparison import compare_files

KNOWN = TableMachine(references={"": 0.0})


def found(text: str, known: TableMachine = KNOWN) -> dict[str, str]:
    return {one.code: str(one.error) for one in TableFiles().findings(text, "script.ini", known)}


def measured(up: list[float], down: list[float], spacing: float = 50.0) -> MeasuredSet:
    """Three repetitions around the given means, um over mm."""
    scatter = np.array([-0.3, 0.0, 0.3])
    means = np.stack([up, down], axis=1)
    return MeasuredSet(spacing * np.arange(len(up)), means[:, None, :] + scatter[None, :, None], "mm")


def ours(up: list[float], down: list[float], to: str = "axis", spacing: float = 50.0) -> str:
    request = TableRequest(to, "X1", 0.0, FileDatum(0.0))  # type: ignore[arg-type]
    return writer.render_file(TableFile(convert(measured(up, down, spacing), request).tables))


class TestFixedEncoderNoEqualsNothingChecked:
    """Encoder index fixed to 1, no equals sign, counted from 1, no unit, count or reference check, three ends."""

    values = (3.0, 5.0, 2.0)  # um, written as they are

    def text(self, mark: str, encoder: int = 1) -> str:
        lines = [f"$AA_ENC_COMP[{encoder},{n},X1]{mark}{value}" for n, value in enumerate(self.values, 1)]
        grid = {"STEP": 50, "MIN": 0, "MAX": 100, "IS_MODULO": 0}
        lines += [f"$AA_ENC_COMP_{name}[{encoder},X1]{mark}{value}" for name, value in grid.items()]
        return "\n".join(["%_N_AX_EEC_INI", "CHANDATA(1)", *lines, "m0", "m30", "M17"])

    def test_no_equals_sign(self) -> None:
        with pytest.raises(FileFormatError, match="line 3 has no equals sign"):
            reader.read_tables(self.text("  "), "script.ini")
        errors = [one for one in TableFiles().findings(self.text("  "), "f") if one.code == "E-TABLE-EQUALS"]
        assert len(errors) == 7

    def test_counted_from_one(self) -> None:
        words = found(self.text("="))
        assert "point 0 of 0 .. 2 is missing" in words["E-TABLE-GAP"]
        assert "M30 in line 11, M17 in line 12" in words["W-TABLE-ENDS"]
        assert "line 10: M0 stops the program" in words["W-TABLE-STOP"]

    def test_encoder_unit_count_and_reference(self) -> None:
        text = self.text("=").replace(",1,X1]", ",0,X1]").replace(",2,X1]", ",1,X1]").replace(",3,X1]", ",2,X1]")
        words = found(text)
        assert "measuring system 2" in words["W-TABLE-ENCODER"]
        assert "5 mm, looks like µm written as mm" in words["W-TABLE-LARGE-UNIT"]
        assert "it must be zero" in words["E-TABLE-REFERENCE"]
        assert "the limit is 0.2 mm" in words["E-TABLE-VALUE"]

    def test_ours_has_none_of_it(self) -> None:
        text = ours([3.0, 5.0, 2.0], [3.0, 5.0, 2.0])
        assert found(text) == {}
        assert "$AA_ENC_COMP[0,0,X1]=0.000000\n$AA_ENC_COMP[0,1,X1]=0.002000\n" in text
        assert text.endswith("M17\n")


class TestSwappedDirectionsAndHardWiredPoints:
    """Means of both directions exchanged, 126 points whatever was measured."""

    up, down = [0.0, 4.0, 6.0], [0.0, -2.0, -4.0]

    def test_a_swapped_pair_differs_from_ours_at_every_point(self) -> None:
        right, swapped = ours(self.up, self.down, "cross"), ours(self.down, self.up, "cross")
        difference = compare_files(reader.read_tables(right, "right"), reader.read_tables(swapped, "swapped"))
        assert not difference.same
        assert difference.largest is not None
        assert abs(difference.largest[2]) == pytest.approx(10.0)

    def test_ours_keeps_each_direction(self) -> None:
        plus, minus = reader.read_tables(ours(self.up, self.down, "cross"), "ours").tables
        assert (plus.direction, plus.deviations) == (1, (0.0, 4.0, 6.0))
        assert (minus.direction, minus.deviations) == (-1, (0.0, -2.0, -4.0))
        (mean,) = reader.read_tables(ours(self.up, self.down), "ours").tables
        assert mean.deviations == (0.0, 1.0, 1.0)

    @pytest.mark.parametrize(("last", "code"), [(100, "E-TABLE-BEYOND"), (200, "E-TABLE-GAP")])
    def test_126_points_on_another_grid(self, last: int, code: str) -> None:
        points = "".join(f"$AA_ENC_COMP[0,{n},AX1]={0.001 * (n % 2)}\n" for n in range(126))
        grid = f"$AA_ENC_COMP_STEP[0,AX1] = 1\n$AA_ENC_COMP_MIN[0,AX1] = 0\n$AA_ENC_COMP_MAX[0,AX1] = {last}\n"
        with pytest.raises((FileFormatError, Exception), match=code):
            reader.read_tables("%_N_AX1_EEC_INI\nCHANDATA(1)\n" + grid + points + "M17\n", "script.ini")

    def test_ours_has_as_many_points_as_targets(self) -> None:
        (table,) = reader.read_tables(ours([0.0] * 7, [1.0] * 7), "ours").tables
        assert len(table.deviations) == 7


class TestGridPrintedWithoutDecimals:
    """STEP, MIN and MAX printed as whole numbers, IS_MODULO -1."""

    def text(self, step: float, points: int, modulo: int = 0) -> str:
        grid = {"STEP": f"{step:.0f}", "MIN": "0", "MAX": f"{step * (points - 1):.0f}", "IS_MODULO": str(modulo)}
        lines = ["$AN_CEC_INPUT_AXIS[0]=(C1)", "$AN_CEC_OUTPUT_AXIS[0]=(C1)"]
        lines += [f"$AN_CEC_{name}[0]={value}" for name, value in grid.items()]
        return "\n".join([*lines, *(f"$AN_CEC[0,{n}]=0.0001" for n in range(points)), "M0", "M17"])

    def test_half_a_degree_becomes_nothing(self) -> None:
        assert "step 0.0 and range 0.0 .. 2.0 do not define a grid" in found(self.text(0.5, 5))["E-TABLE-GRID"]

    def test_seven_and_a_half_becomes_eight(self) -> None:
        words = found(self.text(7.5, 49))  # 8 divides 360, so the points are what does not fit
        assert "point 46 is beyond point 45" in words["E-TABLE-BEYOND"]
        assert "does not divide" in found(self.text(7.5, 6))["W-TABLE-STEP"]

    def test_modulo_minus_one(self) -> None:
        with pytest.raises(FileFormatError, match="-1 must be 0 or 1"):
            reader.read_tables(self.text(10.0, 37, -1), "script.spf")

    @pytest.mark.parametrize("step", [0.5, 7.5, 0.1])
    def test_ours_keeps_every_decimal(self, step: float) -> None:
        (table,) = reader.read_tables(ours([0.0, 0.01, 0.0], [0.0, 0.01, 0.0], spacing=step), "ours").tables
        assert (table.step, table.maximum, table.modulo) == (step, 2 * step, False)


class TestMeansDividedByPositions:
    """ISO 230-2 means divided by the number of positions, and the last position's scatter used for all."""

    def test_five_positions_and_three_cycles(self) -> None:
        readings = np.zeros((5, 3, 2))
        readings[:, :, 0] = np.array([1.0, 2.0, 3.0])  # mean 2, s = 1; a fifth of the sum would be 1.2
        readings[0, :, 0] = np.array([-2.0, 2.0, 6.0])  # s = 4 at the first position only
        result = evaluate_iso230_2(np.arange(5.0), readings, "um", edition="2014")
        assert list(result.mean_up) == [2.0] * 5
        assert list(result.s_up) == pytest.approx([4.0, 1.0, 1.0, 1.0, 1.0])
        assert result.R_up == pytest.approx(16.0)  # 4 s of the worst position, not s, not of the last

    def test_our_tables_take_the_mean_of_the_cycles(self) -> None:
        (table,) = reader.read_tables(ours([0.0, 2.0, 2.0, 2.0, 2.0], [0.0, 4.0, 4.0, 4.0, 4.0]), "ours").tables
        assert table.deviations == (0.0, 3.0, 3.0, 3.0, 3.0)
