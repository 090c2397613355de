"""The corrected copy of a program: what is read and refused, where the copy goes, and the same part as by tables."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from drivers.types.tables import CompensationTable, reversal_of
from gateway.cli import app
from gateway.domain.proposals import Proposal
from gateway.gear.first_order import flank_abg
from gateway.gear.flank import flank_figure
from gateway.gear.grinding import Grinding
from gateway.model.error_model import yk7350b
from gateway.model.motion import Fourier, Polynomial
from gateway.shadow.reading import ProgramAxis, ProgramBlock, ProgramReader
from gateway.shadow.writing import CopySettings, FieldCorrection, TableCorrection, write_copy
from gateway.store import Store
from gateway.workflow.run import stages
from gateway.workflow.tooth.shadowing import check_copy, field_correction
from tests.unit.approve.test_approve import CHANGE, MACHINE
from tests.unit.approve.test_command import SITE
from tests.unit.approve.test_consents import SKIPPED
from tests.unit.gear.machines import DISC
from tests.unit.nck.bench import on_bench
from tests.unit.nck.test_cec import load, table

AXES = (
    ProgramAxis("X", travel=(-300.0, 700.0), velocity=30_000.0, acceleration=2.0),
    ProgramAxis("Y"),
    ProgramAxis("Z", travel=(-100.0, 600.0), velocity=30_000.0, acceleration=2.0),
    ProgramAxis("C", rotary=True, modulo=True),
)
LETTERS = {"X1": "X", "Z1": "Z", "C1": "C"}


def cross(source: str, output: str, step: float, values: tuple[float, ...], **more: object) -> CompensationTable:
    """Deviations in um or arcsec over the source from 0 on."""
    units = {"input_unit": "deg" if source == "C1" else "mm", "output_unit": "deg" if output == "C1" else "mm"}
    top = step * (len(values) - 1)
    return CompensationTable("cross", source, output, 0.0, top, step, values, **(units | more))  # type: ignore[arg-type]


BOW = cross("Z1", "X1", 25.0, (0.0, 8.0, 12.0, 5.0, 0.0))
ROUND = cross("C1", "X1", 90.0, (0.0, 3.0, 0.0, -4.0, 0.0), modulo=True)


def read(text: str, **frames: dict[str, float]) -> tuple[ProgramBlock, ...]:
    subs = {"DEEPER": "G1 X=IC(-1) F500\nM17\n"}
    return ProgramReader(AXES, frames=frames, subprogram=subs.get).read(text, "builder.mpf")


def ends(text: str, **frames: dict[str, float]) -> list[dict[str, float]]:
    return [dict(one.move.end) for one in read(text, **frames) if one.move is not None]


def test_moves_are_read_in_machine_coordinates_with_everything_that_stays_in_force() -> None:
    text = """; a builder's cycle
        N10 G54 G90 G64 G17
        N20 G0 X10 Z=5 C=DC(350)
        TRANS X2
        N30 G1 X20 F1000
        G91 Z10
        N50 DEEPER ; deeper
        SUPA G0 G90 X-50
        C=ACP(10) M3 S1500
        G1 C=IC(720) F7200
        MSG("out") M30
        X999"""
    assert ends(text, G54={"X": -100.0}) == [
        {"X": -90.0, "Z": 5.0, "C": 350.0},
        {"X": -78.0, "Z": 5.0, "C": 350.0},
        {"X": -78.0, "Z": 15.0, "C": 350.0},
        {"X": -79.0, "Z": 15.0, "C": 350.0},
        {"X": -50.0, "Z": 15.0, "C": 350.0},
        {"X": -50.0, "Z": 15.0, "C": 370.0},
        {"X": -50.0, "Z": 15.0, "C": 1090.0},
    ]


@pytest.mark.parametrize(
    ("block", "middle", "length"),
    [
        ("G2 X20 Y0 I10 J0", (10.0, 10.0), 10.0 * np.pi),
        ("G3 X20 Y0 CR=10", (10.0, -10.0), 10.0 * np.pi),
        ("G3 X10 Y10 I0 J10", (5.0 * np.sqrt(2.0), 10.0 - 5.0 * np.sqrt(2.0)), 5.0 * np.pi),
        ("G2 X10 Y10 CR=-10", (10.0 - 5.0 * np.sqrt(2.0) - 10.0, 5.0 * np.sqrt(2.0) + 10.0), 15.0 * np.pi),
        ("G2 I10", (20.0, 0.0), 20.0 * np.pi),
    ],
)
def test_arcs_run_the_way_the_manual_says(block: str, middle: tuple[float, float], length: float) -> None:
    move = read(f"G0 X0 Y0\n{block} F600")[-1].move
    assert move is not None
    half = move.at(0.5)
    assert (half["X"], half["Y"]) == pytest.approx(middle, abs=1e-9)
    assert move.length({axis.letter: axis for axis in AXES}) == pytest.approx(length)


@pytest.mark.parametrize(
    ("text", "line", "code"),
    [
        ("G0 X1\nR1=5", 2, "E-SHADOW-WORD"),
        ("G0 X=R1", 1, "E-SHADOW-WORD"),
        ("IF R1>2 GOTOF END", 1, "E-SHADOW-WORD"),
        ("CYCLE800(1)", 1, "E-SHADOW-WORD"),
        ("\nUNKNOWN", 2, "E-SHADOW-WORD"),
        ("TRANSMIT", 1, "E-SHADOW-WORD"),
        ("G70", 1, "E-SHADOW-WORD"),
        ("G41 G1 X1 F100", 1, "E-SHADOW-WORD"),
        ("T5", 1, "E-SHADOW-WORD"),
        ("D1", 1, "E-SHADOW-WORD"),
        ("/G0 X1", 1, "E-SHADOW-WORD"),
        ("ROT Z30", 1, "E-SHADOW-WORD"),
        ("G1 AP=30 RP=10 F100", 1, "E-SHADOW-WORD"),
        ("G0 X1 X2", 1, "E-SHADOW-WORD"),
        ("G0 Q5", 1, "E-SHADOW-WORD"),
        ("X5", 1, "E-SHADOW-WORD"),
        ("G0 X1.5.2", 1, "E-SHADOW-WORD"),
        ("DEEPER F100", 1, "E-SHADOW-WORD"),
        ("DEEPER NORM", 1, "E-SHADOW-WORD"),
        ("TRANS X2 F100", 1, "E-SHADOW-WORD"),
        ("G0 X1\nTRANS X3\nX=IC(1)", 3, "E-SHADOW-WORD"),
        ("TRANS X3\nG0 X1\nSUPA X=IC(1)", 3, "E-SHADOW-WORD"),
        ("TRANS C30", 1, "E-SHADOW-WORD"),
        ("G55", 1, "E-SHADOW-FRAME"),
        ("G1 X1", 1, "E-SHADOW-VALUE"),
        ("G1 X1 F0", 1, "E-SHADOW-VALUE"),
        ("G91 G0 X1", 1, "E-SHADOW-START"),
        ("G2 X1 Y1 CR=5 F100", 1, "E-SHADOW-START"),
        ("G0 X0 Y0\nG2 X10 Y0 CR=4 F100", 2, "E-SHADOW-ARC"),
        ("G0 X0 Y0\nG2 X10 Y0 I4 J0 F100", 2, "E-SHADOW-ARC"),
        ("G0 X0 Y0\nG2 X10 Y0 F100", 2, "E-SHADOW-ARC"),
    ],
)
def test_what_is_not_understood_is_refused_by_its_line(text: str, line: int, code: str) -> None:
    with pytest.raises(TrueflankError) as refused:
        read(text)
    assert refused.value.code == code
    assert refused.value.where == f"builder.mpf:{line}"


PROGRAM = """G0 X50 Y0 C=DC(0) Z0
G1 Z100 F3000
C=ACP(120) F7200
G1 Z0 F3000
G2 X60 Y0 I5 J0 F600
M30"""


def test_the_copy_goes_where_the_program_went_less_the_tables_deviations() -> None:
    """At every written position, and between them: the commanded X less what both tables hold there, by hand."""
    correction = TableCorrection([BOW, ROUND], letters=LETTERS)
    copy = write_copy(read(PROGRAM), AXES, correction)
    check_copy(ProgramReader(AXES), copy, AXES)
    moves = [one.move for one in ProgramReader(AXES).read(copy.text) if one.move is not None]
    for move, point in zip(moves, copy.points, strict=True):
        for share in (0.3, 1.0) if move.kind == "line" else (1.0,):
            at = move.at(share)
            bow = np.interp(at["Z"], [0.0, 25.0, 50.0, 75.0, 100.0], [0.0, 8.0, 12.0, 5.0, 0.0])
            around = np.interp(at["C"] % 360.0, [0.0, 90.0, 180.0, 270.0, 360.0], [0.0, 3.0, 0.0, -4.0, 0.0])
            if point.line < 5:
                assert at["X"] == pytest.approx(50.0 - 1e-3 * (bow + around), abs=1.5e-4)
    arc = np.array([[m.end["X"] + 1e-3 * 2.0, m.end["Y"]] for m in moves[-20:]])  # C = 120: 2 um
    assert np.hypot(arc[:, 0] - 55.0, arc[:, 1]) == pytest.approx(5.0, abs=2e-4)
    assert copy.largest()["X"] == pytest.approx(-0.014, abs=0.001)
    assert copy.uncorrected == ()


def test_acting_tables_are_taken_off_and_the_same_tables_change_nothing() -> None:
    nothing = write_copy(read(PROGRAM), AXES, TableCorrection([BOW], [BOW], letters=LETTERS))
    assert max(map(abs, nothing.largest().values())) == 0.0
    half = cross("Z1", "X1", 25.0, (0.0, 4.0, 6.0, 2.5, 0.0))
    found = write_copy(read(PROGRAM), AXES, TableCorrection([BOW], [half], letters=LETTERS))
    assert found.largest()["X"] == pytest.approx(-0.006, abs=1e-4)


def test_what_no_table_can_hold_is_carried() -> None:
    """X = 5 um sin(pi Z / 100) cos C, a product: the copy leaves it by the chord tolerance at most."""
    z, turn = np.linspace(0.0, 100.0, 201), np.arange(0.0, 360.0, 1.0)
    grid = 5e-3 * np.sin(np.pi * z / 100.0)[:, None] * np.cos(np.deg2rad(turn))[None, :]
    field = FieldCorrection("Z", z, "C", turn, {"X": grid})
    copy = write_copy(read(PROGRAM), AXES, field, CopySettings(longest={"Z": 10.0, "C": 10.0}))
    for point in copy.points:
        wanted = 5e-3 * np.sin(np.pi * point.positions["Z"] / 100.0) * np.cos(np.deg2rad(point.positions["C"]))
        assert point.added["X"] == pytest.approx(wanted, abs=2e-6)


def test_words_of_a_block_keep_their_digits_and_their_end() -> None:
    """A shift of ten digits is written whole, and a long move stops exactly (G9) where the program stopped."""
    text = "N1000010 TRANS X-123.456789\nG0 X50 Y0 Z0 C=DC(0)\nG9 G1 Z100 F3000 M8"
    copy = write_copy(read(text), AXES, TableCorrection([BOW], letters=LETTERS))
    check_copy(ProgramReader(AXES), copy, AXES)
    lines = copy.text.splitlines()
    assert "N1000010 TRANS X-123.456789" in lines
    assert ["G9" in line.split() for line in lines].index(True) == len(lines) - 1
    assert ["M8" in line for line in lines].index(True) == 4


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"values": (0.0, 900.0, 0.0)}, "E-SHADOW-LIMIT"),
        ({"program": "G0 X-299.999 Z50 C0\nG1 Z0 F100"}, "E-SHADOW-TRAVEL"),
        ({"program": "G0 X1 C0\nG1 X5 F100"}, "E-SHADOW-START"),
        ({"program": "G0 X1 C0\nG1 Z5 F100"}, "E-SHADOW-START"),
        ({"program": "G0 Z0 C0\nG1 Z5 F100"}, "E-SHADOW-START"),
        ({"program": "G0 X1 Z0 C0\nG1 Z100 F30000", "velocity": 29_000.0}, "E-SHADOW-FEED"),
        ({"program": "G0 X1 Z0 C0\nG1 Z100 F30000", "acceleration": 1e-4}, "E-SHADOW-ACCELERATION"),
        ({"direction": 1}, "E-SHADOW-TABLE"),
        ({"multiply_by": 2}, "E-SHADOW-TABLE"),
    ],
)
def test_limits_are_kept(change: dict[str, object], code: str) -> None:
    program = str(change.pop("program", PROGRAM))
    limits = {name: change.pop(name) for name in ("velocity", "acceleration") if name in change}
    values = change.pop("values", (0.0, 12.0, 0.0))
    axes = (ProgramAxis("X", travel=(-300.0, 700.0), **({"acceleration": 50.0} | limits)), *AXES[1:])  # type: ignore[arg-type]
    if "velocity" in limits:  # X itself is driven as fast as Z: the correction goes on top
        axes = (ProgramAxis("X", velocity=1.0), *AXES[1:])
    one = cross("Z1", "X1", 50.0, values, **change)  # type: ignore[arg-type]
    with pytest.raises(TrueflankError) as refused:
        write_copy(read(program), axes, TableCorrection([one], letters=LETTERS))
    assert refused.value.code == code


async def test_the_simulated_control_cuts_the_same_by_tables_and_by_the_copy() -> None:
    """X over Z and C on the 840D's simulator: original with CEC tables, then the copy without them, at 200 moments."""
    program = "G0 X50 C=DC(0)\nZ0\nG1 Z100 F3000\nG4 F1\nG0 C=ACP(130)\nG1 Z10 F3000\nG4 F1\nM30"
    text = table(0, "Z1", "X1", [0.0, 0.008, 0.012, 0.005, 0.0], 0.0, 25.0)
    text += table(1, "C1", "X1", [0.0, 0.003, 0.0, -0.004, 0.0], 0.0, 90.0)
    copy = write_copy(
        read(program), AXES, TableCorrection([BOW, ROUND], letters=LETTERS), CopySettings(longest={"Z": 5.0})
    )
    paths = []
    for nc, tables in ((program, text), (copy.text, "")):
        async with on_bench() as bench:
            if tables:
                await load(bench, tables, "X1")
            begin = bench.clock.now()
            await bench.run(nc)
            assert bench.numbers() == []
            times = np.linspace(begin, bench.clock.now(), 4000)
            x, z, c = (bench.nck.encoder(axis, times)[0] for axis in ("X1", "Z1", "C1"))
            paths.append((x, z, c % 360.0))
    by_tables, by_copy = paths
    for turned in (0.0, 130.0):
        known = []
        for x, z, c in (by_tables, by_copy):
            here = (np.abs(c - turned) < 1e-3) & (np.abs(x - 50.0) < 0.1) & (z > 12.0) & (z < 98.0)
            order = np.argsort(z[here])
            known.append(np.interp(np.linspace(13.0, 97.0, 100), z[here][order], x[here][order]))
        assert np.ptp(known[0]) > 0.009
        assert np.max(np.abs(known[0] - known[1])) < 5e-4  # chord tolerance, and how far the drives lag


BACKLASH = replace(CHANGE, old=reversal_of("X1", "mm", 0.0), new=reversal_of("X1", "mm", 3.0))


@dataclass(frozen=True)
class Carried:
    """What the copy adds to one axis, as something that acts on the gear's grinding."""

    field: FieldCorrection
    out: str
    inputs: tuple[str, ...] = ("Z", "C")

    def added(self, q: Mapping[str, np.ndarray]) -> np.ndarray:
        z, c = np.broadcast_arrays(q["Z"], np.rad2deg(q["C"]))
        values = [
            self.field({"Z": float(a), "C": float(b)})[self.out] for a, b in zip(z.ravel(), c.ravel(), strict=True)
        ]
        found = np.array(values).reshape(z.shape)
        return np.deg2rad(found) if self.out == "C" else found


def test_the_error_models_field_takes_a_machines_errors_off_the_flank() -> None:
    """A product error EXZ(z) that C turns against: the flank by the chain, at places beside the grid's own."""
    chain = yk7350b({"EXZ": Polynomial((0.0, 0.004, 0.003), 0.0, 10.0), "ECC": Fourier(0.0, (0.0, 3e-5), (1e-5,))})
    grinding = Grinding(chain, DISC, 190.0)
    field = field_correction(grinding)
    spaces, heights = np.arange(11.0)[:, None], np.linspace(-6.9, 6.9, 9)
    corrected = replace(grinding, tables=(Carried(field, "X"), Carried(field, "C")))
    before, after = (flank_abg(one, spaces, heights) for one in (grinding, corrected))
    section = DISC.section(DISC.theta_at(np.linspace(-0.9, 0.9, 20) * DISC.limits().half_lobe_arc))
    form = np.stack([section.nx, section.ny, section.h], axis=1)
    old, new = (np.einsum("ti,kzi->ktz", form, one) for one in (before, after))
    old, new = (flank_figure(one, section.h[None, :, None]).rms for one in (old, new))
    assert new < 0.1 * old


def test_the_command_writes_prints_and_draws_the_copy(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    site.write_text(SITE, encoding="utf-8")
    folder = Store(tmp_path / "runs").create("mill", {"site_file": str(site)})
    folder.put(stages.PROPOSAL, Proposal(MACHINE, (CHANGE, BACKLASH, SKIPPED), (), "2026-11-21T10:00:00+00:00"))
    program = tmp_path / "cycle.mpf"
    program.write_text("G54 G90 G0 X5\nSUB1\nM30\n", encoding="utf-8")
    (tmp_path / "SUB1.SPF").write_text("G1 X95 F1000\nM17\n", encoding="utf-8")
    words = ["shadow", str(program), "--site", str(site), "--run", str(folder.path)]
    refused = CliRunner().invoke(app, words)
    assert isinstance(refused.exception, TrueflankError)
    assert refused.exception.code == "E-SHADOW-FRAME"
    done = CliRunner().invoke(app, [*words, "--frame", "G54:X=1", "--json"])
    assert done.exit_code == 0, done.output
    data = json.loads(done.output)
    copy = (tmp_path / "cycle-corrected.mpf").read_text()
    assert program.read_text() == "G54 G90 G0 X5\nSUB1\nM30\n"
    wanted = CHANGE.new.at(np.array([6.0, 96.0])) - CHANGE.old_enabled * CHANGE.old.at(np.array([6.0, 96.0]))
    last = [line for line in copy.splitlines() if line.startswith("G1")][-1]
    assert float(last.split("X")[1].split()[0]) == pytest.approx(95.0 - 1e-3 * wanted[1], abs=1e-6)
    assert (tmp_path / "cycle-corrected.png").stat().st_size > 5000
    assert data["points"] >= 3
    assert data["left_out"] == ["X1-reversal"]
    assert "X1-reversal" in CliRunner().invoke(app, [*words, "--frame", "G54:X=1"]).output
    turned = CliRunner().invoke(app, [*words, "--frame", "G54:Q=1"])
    assert isinstance(turned.exception, TrueflankError)
    assert turned.exception.code == "E-SHADOW-LETTER"
    (tmp_path / "sub1.mpf").write_text("M17\n", encoding="utf-8")
    double = CliRunner().invoke(app, [*words, "--frame", "G54:X=1"])
    assert isinstance(double.exception, TrueflankError)
    assert double.exception.code == "E-SHADOW-READ"
    same = CliRunner().invoke(app, [*words, "--frame", "G54:X=1", "--out", str(program)])
    assert isinstance(same.exception, TrueflankError)
    assert same.exception.code == "E-SHADOW-SAME"
