"""Inspected parts from files or a run, by cause; the wheel's correction for the dresser, and the proof of its sense."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError
from drivers.message import Message, fixed
from gateway.config import SiteFile
from gateway.domain.grinding_process import Separation, SetupHandover
from gateway.domain.outcomes import PushRecord
from gateway.errors import IllegalTransition, ModelError, StoreError
from gateway.gear.cycloid import CycloidGear
from gateway.process.charts import BASE, PartFigures, ProcessAnswer, judge_process
from gateway.process.separation import separate
from gateway.process.wheel import (
    SenseProof,
    WheelCorrection,
    corrected_points,
    prove_sense,
    step_form,
    wheel_correction,
)
from gateway.process.wheel_form import ProcessPart
from gateway.store import RunFolder, checked_name
from gateway.study.dresser import load_dresser, separation_data, write_dresser, write_wheel, write_wheel_dxf
from gateway.study.inputs import GearFile, gear_of, load_gear
from gateway.tooth import GearProposal, GroundPart, InspectedFlank
from gateway.workflow.run import stages
from gateway.workflow.tooth.pairing import DiscFile, disc_of_file
from gateway.workflow.tooth.part_plan import gear_of_site, work_section
from gateway.workflow.tooth.verdict import rms_beside

ORDERS = ("unknown", "ascending", "descending")
VERDICTS = {
    "proved": "W-WHEEL-PROVED",
    "reversed": "W-WHEEL-REVERSED",
    "exchanged": "W-WHEEL-EXCHANGED",
    "reversed and exchanged": "W-WHEEL-BOTH",
    "not seen": "W-WHEEL-NOT-SEEN",
    "not decidable": "W-WHEEL-UNDECIDED",
}


def order_of(text: str, spaces: int) -> tuple[int, ...] | None:
    """The order of grinding from "unknown", "ascending", "descending" or the numbers "0,7,14,...".

    Raises ConfigError (E-PROCESS-ORDER-TEXT) for anything else.
    """
    if text in ("", "unknown"):
        return None
    if text in ORDERS:
        ascending = tuple(range(spaces))
        return ascending if text == "ascending" else ascending[::-1]
    try:
        return tuple(int(one) for one in text.replace(";", ",").split(","))
    except ValueError:
        raise ConfigError("E-PROCESS-ORDER-TEXT", "--order", text=text, known=", ".join(ORDERS)) from None


@dataclass(frozen=True, slots=True)
class SeparationOutcome:
    """Parts by cause, of which gear; ``verified`` says what set-up values handed over before did."""

    gear: GearFile
    found: Separation
    verified: tuple[Message, ...] = ()

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """Share, RMS, u; the details are set in below."""
        rows = [(one.name, f"{one.rms_um:.2f}", f"{one.u_um:.2f}") for one in self.found.shares]
        return rows + [(f"  {one.name}", f"{one.rms_um:.2f}", f"{one.u_um:.2f}") for one in self.found.details]

    @property
    def lines(self) -> tuple[Message, ...]:
        """What goes with the table, for people."""
        found = self.found
        values = {
            f"{key}_{what}": fixed(getattr(found.setup[key], what))
            for key in ("x_um", "dressing_um")
            for what in ("value", "u")
        }
        pairs = [
            Message.of("S-PROCESS-CORRELATED", first=a, second=b, r=fixed(r, 2, signed=True))
            for a, b, r in found.correlations
        ]
        swivel = found.setup["swivel_arcsec"]
        seen = math.isfinite(swivel.u)
        told = {"swivel": fixed(swivel.value), "u": fixed(swivel.u)} if seen else {}
        more = (Message.of("W-PROCESS-SWIVEL", **told),) if seen else ()
        return (Message.of("W-PROCESS-SETUP", **values), *more, *self.verified, *found.said, *pairs)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        return {"gear": self.gear.name, **separation_data(self.found)}


@dataclass(frozen=True, slots=True)
class RedressOutcome:
    """Files for the dresser, and what they hold; ``step`` where it is the known step."""

    correction: WheelCorrection
    files: tuple[Path, ...]
    step: bool
    separation: Separation

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        largest = float(abs(self.correction.correction_um).max())
        told = {
            "rms": fixed(self.correction.rms_um),
            "largest": fixed(largest),
            "points": self.correction.theta_rad.size,
        }
        if self.step:
            return (Message.of("P-WHEEL-STEP", **told),)
        left = fixed(float((self.correction.u_um**2).mean() ** 0.5), 3)
        said = self.separation.said[:1] if self.separation.diamond_named else ()
        return (Message.of("P-WHEEL-CORRECTION", left=left, **told), Message.of("S-WHEEL-RANGE"), *said)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        found = self.correction
        return {
            "step": self.step,
            "rms_um": found.rms_um,
            "files": [str(one) for one in self.files],
            "correction_um": found.correction_um.tolist(),
            "radius_mm": found.radius_mm.tolist(),
            "axial_mm": found.axial_mm.tolist(),
        }


@dataclass(frozen=True, slots=True)
class ProofOutcome:
    """What a known step did, and where the proof is kept."""

    proof: SenseProof
    path: Path

    @property
    def exit_code(self) -> int:
        """0 proved, 1 anything else."""
        return 0 if self.proof.verdict == "proved" else 1

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        seen = self.proof
        code = VERDICTS[seen.verdict]
        return (Message.of(code, gain=fixed(seen.gain), other=fixed(seen.other), u=fixed(seen.u), file=str(self.path)),)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        seen = self.proof
        return {"gain": seen.gain, "other": seen.other, "u": seen.u, "verdict": seen.verdict, "file": str(self.path)}


def separate_files(
    gear_path: Path, files: Sequence[Path], how: DiscFile | None = None, *, order: str = "unknown"
) -> SeparationOutcome:
    """Inspected parts of one dressing from files of flank points, by cause.

    Raises ConfigError (E-STUDY-..., E-PROCESS-ORDER-TEXT, E-INSPECT-FILE), FileFormatError, ModelError (E-INSPECT-...,
    E-PROCESS-...).
    """
    file = load_gear(gear_path)
    gear = gear_of(file)
    return SeparationOutcome(file, separate(gear, _parts(gear, files, how or DiscFile(), order)))


def _parts(gear: CycloidGear, files: Sequence[Path], how: DiscFile, order: str) -> list[ProcessPart]:
    told = order_of(order, gear.zc)
    return [ProcessPart.of(disc_of_file(path, gear, how), order=told, clamping_um=how.clamping_um) for path in files]


def separate_part(site: SiteFile, site_path: Path, folder: RunFolder, found: InspectedFlank) -> SeparationOutcome:
    """An inspected part of a run by cause; set-up values and order are those of its grinding where the run has it.

    The separation is stored as stage ``separated-<part>``. Raises ConfigError, ModelError (E-PROCESS-...).
    """
    gear_file, clamping_um = gear_of_site(site, site_path), work_section(site).inspection_clamping_um
    gear = gear_of(gear_file)
    stage = stages.ground(found.part)
    ground = folder.get(stage, GroundPart) if folder.has(stage) else None
    own = ground is not None and not folder.has(stages.CYCLE)  # nobody knows the order of the builder's cycle
    order = tuple(range(gear.zc)) if own else None
    part = ProcessPart.of(found, setup=None if ground is None else ground.setup, order=order, clamping_um=clamping_um)
    found_causes = separate(gear, [part])
    outcome = SeparationOutcome(
        gear_file, found_causes, (*verify_handover(folder, found_causes), *verify_returned(folder, found, gear))
    )
    folder.put(stages.separated(found.part), outcome.found, (folder.digest(stages.inspected(found.part)),))
    return outcome


def verify_returned(folder: RunFolder, found: InspectedFlank, gear: CycloidGear) -> tuple[Message, ...]:
    """Whether tables that were proposed from a part alone, and pushed, left of the next part what they should.

    Set-up values, rotation and eccentricity of both are taken out; the rest must agree within k = 2.
    """
    pushed = [folder.get(one, PushRecord) for one in folder.stages if one.startswith(stages.push(""))]
    if not folder.has(stages.FROM_GEAR) or not any(one.outcome == "committed" for one in pushed):
        return ()
    said = folder.get(stages.FROM_GEAR, GearProposal)
    if said.part == found.part:
        return ()
    missed = rms_beside(gear, found.fitted, said.after)
    u = math.hypot(said.u_um, found.rms_u_um)
    told = {"before": fixed(said.before.rms_um), "after": fixed(found.fitted.rms_um), "missed": fixed(missed)}
    told |= {"part": said.part, "predicted": fixed(said.after.rms_um), "u": fixed(u)}
    return (Message.of("W-RETURN-HELD" if missed <= 2.0 * u else "W-RETURN-MISSED", **told),)


def verify_handover(folder: RunFolder, found: Separation) -> tuple[Message, ...]:
    """Whether the set-up values handed over last in this run did to this part what they should; nothing without any.

    Each is compared with what was left to be added, within twice the uncertainty of the difference.
    """
    records = [folder.get(one, SetupHandover) for one in folder.stages if one.startswith(stages.handed(""))]
    mine = [one for one in records if one.outcome in ("committed", "typed") and one.part not in found.parts]
    last = max(mine, key=lambda one: one.utc, default=None)
    if last is None or last.step or not folder.has(stages.separated(last.part)):
        return ()
    before = folder.get(stages.separated(last.part), Separation)
    said = []
    for one in last.values:
        was, now = before.asks(one.name), found.asks(one.name)
        u = math.hypot(was.u, now.u)
        done = was.value - now.value
        told = {
            "name": one.name,
            "asked": fixed(one.added, signed=True),
            "done": fixed(done, signed=True),
            "u": fixed(u),
        }
        told |= {"u": fixed(u), "part": last.part, "unit": "arcsec" if one.name == "swivel" else "um"}
        good = abs(done - one.added) <= max(2.0 * u, 0.05)
        said.append(Message.of("W-HAND-VERIFIED" if good else "W-HAND-NOT-VERIFIED", **told))
    return tuple(said)


def redress_files(
    gear_path: Path, files: Sequence[Path], dresser_path: Path, out: Path, how: DiscFile | None = None, *,
    order: str = "unknown", step: bool = False, dxf: bool = False,
) -> RedressOutcome:  # fmt: skip
    """The wheel's correction from inspected parts as files in ``out``: or a known step that proves the dresser's sense.

    Raises what `separate_files` raises, ConfigError (E-WHEEL-UNPROVED, E-WHEEL-SENSE), ModelError (E-WHEEL-...),
    StoreError (E-STUDY-WRITE).
    """
    dresser = load_dresser(dresser_path)
    if not step:
        dresser.demand_proved()
    outcome = separate_files(gear_path, files, how, order=order)
    gear, distance = gear_of(outcome.gear), outcome.gear.grinding.centre_distance_mm
    limits = {"diamond_mm": dresser.data.diamond_radius_mm, "limit_um": dresser.data.limit_um}
    if step:
        form = step_form(gear, outcome.found.form, dresser.data.step_um)
        found = corrected_points(gear, distance, form, **limits)
    else:
        found = wheel_correction(gear, distance, outcome.found, **limits)
    name = "step" if step else "wheel"
    written = [
        write_dresser(out / f"{name}-dresser.csv", dresser.data, found),
        write_wheel(out / f"{name}-points.csv", found),
    ]
    if dxf:
        written.append(write_wheel_dxf(out / f"{name}.dxf", found))
    return RedressOutcome(found, tuple(written), step, outcome.found)


def prove_files(
    gear_path: Path, before: Sequence[Path], after: Sequence[Path], dresser_path: Path, how: DiscFile | None = None
) -> ProofOutcome:
    """Judge the known step by parts ground before and after it, and keep the proof beside the dresser file.

    Raises as `separate_files`; ModelError (E-WHEEL-RANGE), StoreError (E-STUDY-WRITE).
    """
    dresser = load_dresser(dresser_path)
    if set(before) & set(after):
        raise ModelError("E-WHEEL-SAME", str(next(iter(set(before) & set(after)))))
    forms = [separate_files(gear_path, files, how).found.form for files in (before, after)]
    proof = prove_sense(gear_of(load_gear(gear_path)), forms[0], forms[1], dresser.data.step_um)
    return ProofOutcome(proof, dresser.keep(proof))


# ---- Routine parts over time: their figures in the store, and what the charts say.

HISTORY = "process"
EXITS = {"valid": 0, "dress": 20, "measure C only": 20, "cannot tell": 21}
ANSWERS = {
    "valid": "W-PROCESS-VALID",
    "dress": "W-PROCESS-DRESS",
    "measure C only": "W-PROCESS-MEASURE-C",
    "cannot tell": "W-PROCESS-CANNOT-TELL",
}


@dataclass(frozen=True, slots=True)
class RoutineOutcome:
    """What the routine parts of a gear say, with this one."""

    answer: ProcessAnswer

    @property
    def exit_code(self) -> int:
        """0 valid, 20 dress or measure C, 21 cannot tell."""
        return EXITS[self.answer.answer]

    @property
    def lines(self) -> tuple[Message, ...]:
        """For people."""
        seen = self.answer
        if not seen.charts:
            return (Message.of("W-PROCESS-FEW-PARTS", parts=seen.parts, base=BASE),)
        told = {"percent": fixed(100.0 * seen.probability, 1), "tolerance": fixed(seen.tolerance_um)}
        signals = ", ".join(seen.signals) or "-"
        return (Message.of(ANSWERS[seen.answer], parts=seen.parts, signals=signals, **told),)

    def as_data(self) -> dict[str, Any]:
        """For --json."""
        seen = self.answer
        charts = {
            one.name: {"value": one.value, "ewma": one.ewma, "mean": one.mean, "limit": one.limit}
            for one in seen.charts
        }
        chance = seen.probability if seen.charts else None
        return {"answer": seen.answer, "probability": chance, "parts": seen.parts, "charts": charts}


def keep_routine_part(
    root: Path, outcome: SeparationOutcome, found: InspectedFlank, tolerance_um: float, dressed: int = 0
) -> RoutineOutcome:
    """Add a part to the history of its gear in the store (a line of JSON), and judge the process by all of them.

    ``dressed``: parts ground since dressing, with this one; 0 means one more than before. Raises StoreError
    (E-STUDY-WRITE, E-PROCESS-HISTORY: a line of the history cannot be read), IllegalTransition (E-PROCESS-TWICE: this
    inspection is in it).
    """
    path = root / HISTORY / f"{checked_name(outcome.gear.name)}.jsonl"
    known = read_history(path)
    count = dressed or (known[-1].dressed + 1 if known else 1)
    one = PartFigures.of(outcome.found, found.measured_utc, count)
    if any(one.values == other.values for other in known):
        raise IllegalTransition("E-PROCESS-TWICE", str(path), part=one.part)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(one), sort_keys=True) + "\n")
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(path), why=error.strerror or str(error)) from error
    return RoutineOutcome(judge_process([*known, one], tolerance_um))


def read_history(path: Path) -> list[PartFigures]:
    """The routine parts of a gear, oldest first; none where there is no file. Raises StoreError (E-PROCESS-HISTORY)."""
    if not path.is_file():
        return []
    found = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            one = PartFigures(**json.loads(line))
            found.append(replace(one, values=_numbers(one.values), u=_numbers(one.u)))
        except (ValueError, TypeError, AttributeError) as error:
            raise StoreError("E-PROCESS-HISTORY", f"{path}:{number}") from error
    return found


def _numbers(values: Mapping[str, Any]) -> dict[str, float]:
    return {str(name): float(value) for name, value in values.items()}
