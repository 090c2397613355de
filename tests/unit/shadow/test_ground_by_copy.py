"""The same part, truly ground: by tables in the control, and by the corrected copy of the builder's program."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.types.tables import CompensationTable
from gateway.shadow.reading import ProgramAxis, ProgramReader
from gateway.shadow.writing import CopySettings, TableCorrection, write_copy
from simulators.cell import Cell
from simulators.pytest_plugin import CellStarter
from tests.cell.test_grinding import load_cross
from tests.unit.simulators.test_cell import load_table, settled
from tests.unit.simulators.test_cell_grinds import PATH, flank

LETTERS = {"X1": "X", "Z1": "Z", "C1": "C"}
AXES = (
    ProgramAxis("X", travel=(-430.0, 30.0)),
    ProgramAxis("Y"),
    ProgramAxis("Z", travel=(-10.0, 330.0)),
    ProgramAxis("C", rotary=True, modulo=True),
)
ROUND = np.arange(0.0, 361.0, 10.0)
CROSS_UM = 4.0 * np.sin(np.deg2rad(2.0 * ROUND))
OWN_ARCSEC = 5.0 * (1.0 - np.cos(np.deg2rad(3.0 * np.arange(0.0, 361.0, 5.0))))


def program() -> str:
    """The builder's program, its loop written out: the reader refuses variables."""
    lines = [
        "G500 G90 G94 G60",
        'MSG("TRUEFLANK LOAD BLANK RV-40E-LIKE")',
        "M0",
        'MSG("")',
        "G0 Z138",
        "G0 X-170",
        "S1500 M3",
    ]
    for k in range(39):
        lines += [
            f"G0 C=DC({(39 - k) % 39 * 360.0 / 39.0:.6f})",
            "G1 X-160 F1000",
            "G1 Z162 F3000",
            "G1 Z138",
            "G0 X-170",
        ]
    return "\n".join([*lines, "M5", "M30", ""])


def tables() -> list[CompensationTable]:
    units = {"input_unit": "deg", "modulo": True}
    cross = CompensationTable(
        "cross",
        "C1",
        "X1",
        0.0,
        360.0,
        10.0,
        tuple(CROSS_UM.tolist()),
        output_unit="mm",
        **units,  # type: ignore[arg-type]
    )
    own = CompensationTable(
        "axis",
        "C1",
        "C1",
        0.0,
        360.0,
        5.0,
        tuple(OWN_ARCSEC.tolist()),
        output_unit="deg",
        **units,  # type: ignore[arg-type]
    )
    return [cross, own]


@pytest.mark.long
def test_the_flank_by_tables_is_the_flank_by_the_copy(trueflank_cell: CellStarter) -> None:
    """What a clamping may do, an eccentricity and a rotation, is taken out of the difference; the rest is one part."""

    async def main(cell: Cell) -> None:
        async def ground(text: str) -> np.ndarray:
            done = cell.shop.ground
            cell.nck.files.write(PATH, text.encode("ascii"))
            assert cell.nck.select(PATH, 1) == 0
            await cell.clock.sleep(30.0)
            for _ in range(4000):
                await cell.clock.sleep(1.0)
                if cell.nck.channel_status == 0:
                    assert not cell.nck.alarms
                    assert cell.shop.ground is not done
                    return flank(cell)
            raise AssertionError(f"the program did not end: {cell.operator.log}")

        plain = await ground(program())
        # By hand, from the manual and the cell: a table holds mm and deg; CEC acts with the control's own sign.
        sign = cell.nck.spec.cec_sign
        load_cross(cell, -sign * -1e-3 * CROSS_UM)
        load_table(cell, "C1", 0.0, 5.0, (OWN_ARCSEC / 3600.0).tolist(), modulo=1)
        await settled(cell)
        by_tables = await ground(program())
        cell.nck.set("$MA_CEC_ENABLE[X1]", 0, 0)
        cell.nck.set("$MA_ENC_COMP_ENABLE[0,C1]", 0, 0)
        cell.nck.channel_reset()
        await cell.clock.sleep(1.0)
        correction = TableCorrection(tables(), letters=LETTERS)
        copy = write_copy(
            ProgramReader(AXES, frames={"G500": {}}).read(program(), "builder.mpf"),
            AXES,
            correction,
            CopySettings(longest=correction.longest),
        )
        by_copy = await ground(copy.text)
        work = cell.shop.ground
        assert work is not None
        t = work.lobes.even(8)
        point, normal = work.lobes.profile(t)
        phi = 2.0 * np.pi * np.arange(39.0)[:, None, None] / 39.0
        nx, ny = normal.real[None, :, None], normal.imag[None, :, None]
        lever = (point.conjugate() * normal).imag[None, :, None]
        ways = [nx * np.cos(phi) - ny * np.sin(phi), nx * np.sin(phi) + ny * np.cos(phi), lever + 0.0 * phi]
        z = np.linspace(-1.0, 1.0, 3)[None, None, :]
        ways += [one * z for one in ways[:2]]
        design = np.stack([np.broadcast_to(one, plain.shape).ravel() for one in ways], axis=1)

        def rest(difference: np.ndarray) -> float:
            left = difference.ravel() - design @ np.linalg.lstsq(design, difference.ravel(), rcond=None)[0]
            return float(np.sqrt(np.mean(left**2)))

        print(rest(by_tables - plain), rest(by_copy - plain), rest(by_tables - by_copy))
        assert rest(by_tables - plain) > 1.0
        assert rest(by_tables - by_copy) < 0.01

    trueflank_cell.in_memory(main)
