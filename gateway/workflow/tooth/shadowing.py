"""A corrected copy of the builder's own program: read, corrected by a run's tables or model, written, compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message, fixed
from drivers.terms import spoken
from drivers.types.values import FloatArray
from gateway.config import SiteFile
from gateway.correct.flank.flank_model import command_effects, places_of_points
from gateway.domain.proposals import Proposal
from gateway.errors import StoreError
from gateway.gear.first_order import flank_abg
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.shadow.reading import ProgramAxis, ProgramReader
from gateway.shadow.writing import CopySettings, FieldCorrection, ProgramCopy, TableCorrection, write_copy
from gateway.store import RunFolder
from gateway.study.machine import grinding_of
from gateway.study.plots.charts import write_sheet
from gateway.workflow.run import stages
from gateway.workflow.tooth.known_machine import known_machine
from gateway.workflow.tooth.part_plan import gear_of_site, work_section

MOST_BYTES = 8_000_000
HEIGHTS, TURN_STEPS = 41, 360
SHOWN = 12


@dataclass(frozen=True, slots=True)
class ShadowOptions:
    """What is said of a program: frames by G word and letter, the most that axes can do, tolerances in um.

    ``frames`` {"G54": {"X": -160.0}}; ``velocity`` and ``acceleration`` by letter (mm/min, deg/min; m/s2, rev/s2).
    ``by_model``: from the run's error model, for what no table can hold, in place of its proposed tables.
    """

    frames: Mapping[str, Mapping[str, float]]
    velocity: Mapping[str, float]
    acceleration: Mapping[str, float]
    chord_um: float = 0.1
    by_model: bool = False


@dataclass(frozen=True, slots=True)
class ShadowOutcome:
    """The copy, where it and its picture were written, by what it was corrected, and reversals that it lacks."""

    copy: ProgramCopy
    path: Path
    picture: Path
    by: str
    rotary: tuple[str, ...]
    left_out: tuple[str, ...] = ()

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        copy = self.copy
        told = {"points": len(copy.points), "blocks": copy.blocks, "file": str(self.path), "by": self.by}
        largest = [
            Message.of(
                "S-SHADOW-LARGEST", axis=letter, value=fixed(self._shown(letter, value), 2, signed=True),
                unit="arcsec" if letter in self.rotary else "um",
            )
            for letter, value in sorted(copy.largest().items())
        ]  # fmt: skip
        first = sorted(set(copy.uncorrected))
        skipped = [Message.of("S-SHADOW-UNCORRECTED", lines=", ".join(map(str, first[:SHOWN])))] if first else []
        left = [Message.of("S-SHADOW-REVERSAL", tables=", ".join(self.left_out))] if self.left_out else []
        return (Message.of("P-SHADOW", **told), *largest, *skipped, *left, Message.of("S-SHADOW-TABLES"))

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The largest differences to the original: line, axis, position there, position in the copy."""
        every = [
            (abs(value), point, letter, value) for point in self.copy.points for letter, value in point.added.items()
        ]
        every.sort(key=lambda one: -one[0])
        return [
            (
                f"{point.file}:{point.line}",
                letter,
                f"{point.positions[letter]:.4f}",
                f"{point.positions[letter] + value:.6f}",
                f"{self._shown(letter, value):+.2f}",
            )
            for _, point, letter, value in every[:SHOWN]
        ]

    def _shown(self, letter: str, value: float) -> float:
        return value * (3600.0 if letter in self.rotary else 1000.0)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        largest = {letter: self._shown(letter, value) for letter, value in self.copy.largest().items()}
        return {
            "file": str(self.path), "picture": str(self.picture), "blocks": self.copy.blocks,
            "points": len(self.copy.points), "largest": largest, "uncorrected": sorted(set(self.copy.uncorrected)),
            "left_out": list(self.left_out),
        }  # fmt: skip


def shadow_program(
    site: SiteFile, site_path: Path, run: RunFolder, program: Path, out: Path, options: ShadowOptions
) -> ShadowOutcome:
    """Read a program, write its corrected copy, read that copy again and compare both. Nothing goes to the control.

    Raises ConfigError (E-SHADOW-READ, E-SHADOW-SAME: the copy would overwrite the program), StoreError
    (E-STORE-STAGE, E-STUDY-WRITE), ModelError (E-SHADOW-...) with file and line.
    """
    if out.resolve() == program.resolve():
        raise ConfigError("E-SHADOW-SAME", str(out))
    axes = _axes(site, options)
    left: tuple[str, ...] = ()
    correction: FieldCorrection | TableCorrection
    if options.by_model:
        correction = _field(site, site_path, run)
    else:
        correction, left = _tables(site, run)
    chord = options.chord_um
    settings = CopySettings(chord_mm=1e-3 * chord, chord_deg=1e-4 * chord, longest=correction.longest)
    reader = ProgramReader(axes, frames=options.frames, subprogram=lambda name: _subprogram(program, name))
    copy = write_copy(
        reader.read(_text(program), program.name), axes, correction, settings, title=f"{program.name} corrected"
    )
    check_copy(reader, copy, axes)
    path = _write(out, copy.text)
    picture = _draw(out.with_suffix(".png"), copy, axes)
    by = f"{run.run_id} --model" if options.by_model else run.run_id
    return ShadowOutcome(copy, path, picture, by=by, rotary=tuple(a.letter for a in axes if a.rotary), left_out=left)


def check_copy(reader: ProgramReader, copy: ProgramCopy, axes: Sequence[ProgramAxis]) -> None:
    """Read the copy as a program of its own: it must go where its points say. Raises ConfigError (E-SHADOW-COPY)."""
    again = [block for block in reader.read(copy.text, "copy") if block.move is not None]
    rotary = {axis.letter for axis in axes if axis.modulo}
    if len(again) != len(copy.points):
        raise ConfigError("E-SHADOW-COPY", "copy", line=len(again), axis="-", off=len(copy.points))
    for block, point in zip(again, copy.points, strict=True):
        for letter, place in point.positions.items():
            there = block.move.end[letter] if block.move is not None else place
            off = there - place - point.added.get(letter, 0.0)
            off = (off + 180.0) % 360.0 - 180.0 if letter in rotary else off
            if abs(off) > 2e-6:
                raise ConfigError(
                    "E-SHADOW-COPY", f"copy:{block.line}", line=block.line, axis=letter, off=fixed(off, 7)
                )


def _axes(site: SiteFile, options: ShadowOptions) -> tuple[ProgramAxis, ...]:
    known = {axis.letter: axis for axis in site.axes}
    for said in (options.velocity, options.acceleration):
        for letter in said:
            if letter not in known:
                raise ConfigError("E-SHADOW-LETTER", "--velocity, --acceleration", axis=letter, known=", ".join(known))
    linear = [letter for letter, axis in known.items() if axis.kind == "linear"]
    for shifts in options.frames.values():
        for letter in shifts.keys() - set(linear):
            raise ConfigError("E-SHADOW-LETTER", "--frame", axis=letter, known=", ".join(linear))
    found = [
        ProgramAxis(
            letter,
            rotary=axis.kind == "rotary",
            modulo=axis.modulo,
            travel=axis.travel,
            velocity=options.velocity.get(letter),
            acceleration=options.acceleration.get(letter),
        )
        for letter, axis in known.items()
    ]
    work = site.work
    if work is not None and work.dresser and work.dresser_letter and work.dresser_letter not in known:
        found.append(ProgramAxis(work.dresser_letter))
    return tuple(found)


def _tables(site: SiteFile, run: RunFolder) -> tuple[TableCorrection, tuple[str, ...]]:
    """What the run's proposed tables would add to those that act; and the reversals that no position can carry."""
    every = [one for one in run.get(stages.PROPOSAL, Proposal).changes if not one.skipped]
    changes = [one for one in every if one.new.kind != "reversal"]
    left = tuple(one.name for one in every if one.new.kind == "reversal")
    acting = [one.old for one in changes if one.old_enabled]
    letters = {axis.name: axis.letter for axis in site.axes}
    return TableCorrection([one.new for one in changes], acting, letters=letters), left


def _field(site: SiteFile, site_path: Path, run: RunFolder) -> FieldCorrection:
    """The best infeed and index at every height and turn by the run's error model: X(Z, C), C(Z, C)."""
    work = work_section(site)
    grinding = grinding_of(gear_of_site(site, site_path), known_machine(run.path, work.height_mm).errors)
    return field_correction(grinding)


def field_correction(grinding: Grinding) -> FieldCorrection:
    """Infeed and index that leave the least normal deviation at each height of the face and each turn of the work.

    At every wheel place A, B, G of the errors and those of one mm or rad of infeed and index are weighed by the judged
    profile (least squares); a rotation of the whole gear is no deviation and is left out.
    """
    gear = grinding.gear
    spaces = np.arange(TURN_STEPS) / TURN_STEPS * gear.zc
    heights = np.linspace(-0.5, 0.5, HEIGHTS) * gear.b
    k, z = (one.ravel() for one in np.meshgrid(spaces, heights, indexing="ij"))
    section = gear.section(flank_grid(gear, profile=15, width=1, spaces=(0,)).thetas)
    form = np.stack([section.nx, section.ny, section.h], axis=1)
    places = places_of_points(gear, k, 0.0, z)
    effects = command_effects(grinding, places)
    moves = np.stack([effects[name] for name in (grinding.infeed, grinding.index)], axis=2)  # (P, 3, 2)
    seen = np.einsum("ti,pij->ptj", form, moves)
    wanted = np.einsum("ti,pi->pt", form, flank_abg(grinding, places.k, places.z))
    normal = np.einsum("pti,ptj->pij", seen, seen)
    q = -np.linalg.solve(normal, np.einsum("pti,pt->pi", seen, wanted)[..., None])[..., 0]
    command = np.rad2deg(np.asarray(grinding.commands(places.k, places.z)[grinding.index])) % 360.0
    stroke = grinding.stroke_command(places.z)
    order = np.lexsort((command, np.round(stroke, 9)))
    shape = (HEIGHTS, TURN_STEPS)
    x, c = (q[order, i].reshape(shape) for i in (0, 1))
    turn: FloatArray = command[order].reshape(shape)[0]
    values = {grinding.infeed: x, grinding.index: np.rad2deg(c - c.mean())}
    places_mm: FloatArray = stroke[order].reshape(shape)[:, 0]
    return FieldCorrection(grinding.stroke, places_mm, index=grinding.index, turn_deg=turn, values=values)


def _text(path: Path) -> str:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError("E-SHADOW-READ", str(path), why=error.strerror or str(error)) from error
    if len(data) > MOST_BYTES:
        raise ConfigError("E-SHADOW-READ", str(path), why=f"> {MOST_BYTES} bytes")
    return data.decode("latin-1")


def _subprogram(program: Path, name: str) -> str | None:
    """The text of the subprogram in the program's folder; None where there is none. Two of a name are refused."""
    endings = ("", spoken().program_suffix, spoken().tables_suffix)
    wanted = {f"{name}{ending}".casefold() for ending in endings}
    found = sorted(path for path in program.parent.iterdir() if path.name.casefold() in wanted and path.is_file())
    found = [path for path in found if path.resolve() != program.resolve()]
    if len(found) > 1:
        raise ConfigError("E-SHADOW-READ", str(program.parent), why=", ".join(path.name for path in found))
    return _text(found[0]) if found else None


def _write(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="latin-1", newline="\n")
    except (OSError, UnicodeEncodeError) as error:
        raise StoreError("E-STUDY-WRITE", str(path), why=str(error)) from error
    return path


def _draw(path: Path, copy: ProgramCopy, axes: Sequence[ProgramAxis]) -> Path:
    """The correction of every axis from position to position, um and arcsec."""

    rotary = {axis.letter for axis in axes if axis.rotary}
    letters = sorted(copy.largest())

    def paint(figure: Any) -> None:
        panels = figure.subplots(max(len(letters), 1), 1, squeeze=False)[:, 0]
        for panel, letter in zip(panels, letters, strict=False):
            scale = 3600.0 if letter in rotary else 1000.0
            panel.plot([scale * point.added.get(letter, 0.0) for point in copy.points], linewidth=0.8)
            panel.set_ylabel(f"{letter}  {'arcsec' if letter in rotary else 'µm'}")
        panels[-1].set_xlabel("position")

    return write_sheet(path, (9.0, 2.2 * max(len(letters), 1) + 0.6), paint)
