"""Out of the store or out of a file into a file that others read; nothing that exists is replaced unasked."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.errors import ConfigError
from drivers.local.names import shown
from drivers.message import Message
from drivers.recordings import Recording
from drivers.types.gears import GearInspection, GearTraces
from drivers.types.results import MeasuredSet
from drivers.types.values import CompensatedFor
from gateway.domain.captures import Capture, Corrections
from gateway.store import Maps, RunFolder, Store
from gateway.store.raw_stream import open_stream
from gateway.workflow.files.reading import Content, ReadFile, ReadOptions, read_all
from gateway.workflow.run.stages import DOUBLE, GEAR, MEASURED

FORMS = ("rtl", "rta", "csv", "rtx")
STREAM = ".f64"


CORRECTED: Mapping[CompensatedFor, str] = {
    "air+material": "S-CORRECTED-BOTH",
    "air": "S-CORRECTED-AIR",
    "nothing": "S-CORRECTED-NOTHING",
}


@dataclass(frozen=True, slots=True)
class MeasuredItem:
    """Something measured, by where it is: a file, or a run and its stage with the ``capture`` that it was.

    ``names`` are what a set of a file may be called by: its component and its axis.
    """

    label: str
    content: Content
    capture: Capture | None = None
    notes: tuple[Message, ...] = ()
    names: tuple[str, ...] = ()


def sets_of_axis(found: tuple[MeasuredItem, ...], axis: str, where: str) -> tuple[MeasuredItem, ...]:
    """Those sets of a file that an axis or a component names; all for "". Raises ConfigError (E-EXPORT-AXIS)."""
    wanted = axis.upper(), axis.upper().rstrip("0123456789")  # files say X of an axis that the site calls X1
    mine = tuple(one for one in found if not axis or any(name in one.names for name in wanted))
    if not mine:
        known = ", ".join(dict.fromkeys(name for one in found for name in one.names))
        raise ConfigError("E-EXPORT-AXIS", where, axis=shown(axis), known=known or "-")
    return mine


def run_of(word: str | Path, store: Store) -> RunFolder | None:
    """The run meant by a folder, an id, its beginning or `latest`; None for a file: a run's name has no ending.

    Raises StoreError (E-STORE-EMPTY, E-STORE-RUN).
    """
    path = Path(word)
    if path.is_file() or (path.suffix and not path.is_dir()):
        return None
    return store.open(str(word))


def measured_items(
    word: str | Path, how: ReadOptions, store: Store, *, axis: str = "", phase: str = ""
) -> tuple[MeasuredItem, ...]:
    """Everything measured that a file or run holds, of one axis (its name, or its letter) and phase if they are said.

    Raises ConfigError (E-EXPORT-NOTHING), what `read_file` raises, StoreError, CorruptRecord.
    """
    folder = run_of(word, store)
    if folder is None:
        reads = read_all(Path(word), how, Maps(store.root))
        return tuple(
            MeasuredItem(_label(word, one), one.content, notes=one.notes, names=_names_of(one)) for one in reads
        )
    found = tuple(_run_items(folder, axis, phase))
    if not found:
        raise ConfigError("E-EXPORT-NOTHING", str(folder.path), axis=axis or "any axis", phase=phase or "any phase")
    return found


def _names_of(read: ReadFile) -> tuple[str, ...]:
    """What a file's set may be called by: its component, the axis that moved, as file or columns state them."""
    stated = str(getattr(read.content, "header", {}).get("Axis", "")).strip().upper()
    return tuple(dict.fromkeys(name for name in (read.component, read.component[-1:], stated, stated[:1]) if name))


def _label(word: str | Path, read: ReadFile) -> str:
    return f"{word} {read.component}".strip()


def _run_items(folder: RunFolder, axis: str, phase: str) -> Iterator[MeasuredItem]:
    for stage in folder.stages:
        label = f"{folder.run_id}/{stage}"
        if stage.startswith("capture-"):
            capture = folder.get(stage, Capture)
            if axis in ("", capture.axis, capture.component[-1:]) and stage.endswith(phase):
                yield MeasuredItem(label, measured_of(capture, folder), capture)
        elif stage == MEASURED:
            yield MeasuredItem(label, folder.get(stage, MeasuredSet))
        elif stage == GEAR:
            yield MeasuredItem(label, folder.get(stage, GearInspection))
    for path in sorted(folder.path.glob(f"*{STREAM}")):
        recording = open_stream(path)
        if axis in ("", recording.header.get("Axis", "")):
            yield MeasuredItem(f"{folder.run_id}/{path.stem}", recording)


def measured_of(capture: Capture, folder: RunFolder) -> MeasuredSet:
    """A capture as a result file would hold it; targets stay machine coordinates."""
    from gateway.workflow.run.folder import simulated_run  # noqa: PLC0415 - site files are read for a run alone

    header = {"Machine": str(folder.facts["site"]), "Serial No": str(folder.facts["machine"].get("serial", ""))}
    title = f"{capture.component} {folder.run_id}" + (f" {DOUBLE.upper()}" if simulated_run(folder) else "")
    header |= {"Date": capture.started_utc, "Axis": capture.axis, "TITLE": title}
    return MeasuredSet(
        targets=capture.targets,
        deviations=capture.deviations,
        axis_unit=capture.axis_unit,
        ambient_start=capture.ambient_start,
        ambient_end=capture.ambient_end,
        compensated_for=_compensation_facts(capture.corrections),
        expansion_ppm_per_k=capture.corrections.details.get("expansion.ppm_per_k"),
        header=header,
        warnings=capture.notes,
    )


def _compensation_facts(done: Corrections) -> CompensatedFor:
    standing: set[str] = set()
    for step in done.chain:
        (standing.discard if step.undone else standing.add)(step.step)
    if "expansion" in standing:
        return "air+material"
    return "air" if "air" in standing else "nothing"


def export(item: MeasuredItem, form: str, output: Path, *, unit: str = "", force: bool = False) -> tuple[Message, ...]:
    """Write one thing measured as a file; what the form cannot hold is returned in words.

    Raises ConfigError (E-EXPORT-FORM, E-FILE-KIND, E-CLI-EXISTS, E-CLI-WRITE), FileFormatError (E-FILE-RTX-GAPS).
    """
    content = item.content
    dynamic = isinstance(content, Recording)
    if (
        form not in FORMS
        or isinstance(content, GearInspection | GearTraces)
        or (form != "csv" and (form == "rtx") != dynamic)
    ):
        raise ConfigError("E-EXPORT-FORM", item.label, form=form, kind=type(content).__name__)
    if isinstance(content, Recording):
        return _export_recording(content, form, output, unit, force=force)
    driver = _driver(form, "file", unit if form == "rta" else "")
    _write(output, iter([driver.text(content).encode("utf-8")]), force=force)
    return tuple(_lost(content, form, unit))


def _driver(form: str, role: str, unit: str) -> Any:
    factory = registry.load(form, role)
    return factory(unit=unit) if unit else factory()


def _export_recording(content: Recording, form: str, output: Path, unit: str, *, force: bool) -> tuple[Message, ...]:
    chosen = unit or ("mm" if content.unit == "um" else "mrad")
    driver = _driver("rtx", "dynamic-file", chosen)
    if form == "csv":
        _write(output, (text.encode("utf-8") for text in driver.lines(content)), force=force)
        return ()
    temporary = output.with_name(f".{output.name}.{secrets.token_hex(4)}.tmp")
    try:
        _refuse_existing(output, force=force)
        driver.write(temporary, content)
        os.replace(temporary, output)
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(output), why=error.strerror or str(error)) from error
    finally:
        temporary.unlink(missing_ok=True)
    return (Message.of("S-EXPORT-SAMPLES", unit=chosen),)


def _lost(content: MeasuredSet, form: str, unit: str) -> Iterator[Message]:
    if form == "rta":
        yield Message.of("S-EXPORT-DEVIATIONS", unit=unit or "mrad")
    if form == "csv":
        yield Message.of("S-EXPORT-NO-AIR")
    if form in ("rtl", "rta") and content.compensated_for != "air+material":
        yield Message.of("S-EXPORT-CORRECTED", what=Message.of(CORRECTED[content.compensated_for]))


def _refuse_existing(output: Path, *, force: bool) -> None:
    if not force and (output.exists() or output.is_symlink()):
        raise ConfigError("E-CLI-EXISTS", str(output))


def _write(output: Path, pieces: Iterator[bytes], *, force: bool) -> None:
    """A whole file or none; what was there stays until the new one is complete, a link is never followed."""
    temporary = output.with_name(f".{output.name}.{secrets.token_hex(4)}.tmp")
    try:
        _refuse_existing(output, force=force)
        with temporary.open("xb") as file:
            for piece in pieces:
                file.write(piece)
            file.flush()
            os.fsync(file.fileno())
        _refuse_existing(output, force=force)
        os.replace(temporary, output)
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(output), why=error.strerror or str(error)) from error
    finally:
        temporary.unlink(missing_ok=True)
