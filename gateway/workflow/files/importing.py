"""Files of others into the store: kept with their bytes, once only."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from pathlib import Path

from drivers.errors import FileFormatError, FileUnreadable
from drivers.message import Message
from drivers.recordings import Recording
from drivers.types.gears import GearInspection, GearTraces
from drivers.types.results import MeasuredSet
from gateway.config import SiteFile
from gateway.domain.stated import StatedFacts
from gateway.errors import StoreError
from gateway.evaluate.behaviour.doubts import remarks, with_doubts
from gateway.say import Say, silence
from gateway.store import Maps, RunFolder, Store, disk_errors
from gateway.store.raw_stream import RawRecorder, StreamFacts, open_stream
from gateway.watch import Folder, Watcher, WatchJournal, run_bounded
from gateway.workflow.files.reading import OTHER_ENDINGS, Content, ReadFile, ReadOptions, endings, read_all
from gateway.workflow.files.statements import StatementComparison, facts_of
from gateway.workflow.run import stages
from gateway.workflow.run.folder import store_of
from gateway.workflow.run.stages import DYNAMIC, GEAR, MEASURED

STATE = "imported"
CHUNK = 1 << 20
MOST_COMPARED = 10_000  # samples of a recording that tell one unit or scale from another


@dataclass(frozen=True, slots=True)
class ImportedFile:
    """A file, or one motion of it, in the store: ``new`` is false where the same was there with the same meaning."""

    run_id: str
    folder: Path
    sha256: str
    kind: str
    new: bool
    notes: tuple[Message, ...] = field(default_factory=tuple)
    component: str = ""
    stated: StatedFacts = field(default_factory=StatedFacts)


def content_hash(path: Path) -> str:
    """sha256 of a file's bytes. Raises FileUnreadable (E-FILE-READ)."""
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while piece := file.read(CHUNK):
                digest.update(piece)
    except OSError as error:
        raise FileUnreadable("E-FILE-READ", str(path), why=error.strerror or str(error)) from error
    return digest.hexdigest()


def find_import(store: Store, digest: str, meaning: str) -> Path | None:
    """The run that holds this file with this meaning, if any does. Runs that cannot be read are passed over."""
    for summary in store.runs():
        if summary.state == STATE and _imported_hash(summary.path, digest) == meaning:
            return summary.path
    return None


def _imported_hash(path: Path, digest: str) -> str:
    """What a run took from the file of this hash; "" where it is another file's."""
    folder = RunFolder(path)
    try:
        plan = folder.plan
        said = plan.get("imported") if isinstance(plan, Mapping) else None
        if not isinstance(said, Mapping) or said.get("sha256") != digest:
            return ""
        return str(said.get("meaning") or meaning_of(_stored_import(folder)))
    except StoreError:
        return ""


def _stored_import(folder: RunFolder) -> Content:
    """What an import kept. Raises StoreError."""
    if folder.has(MEASURED):
        return folder.get(MEASURED, MeasuredSet)
    if folder.has(GEAR):
        return folder.get(GEAR, GearInspection)
    return open_stream(folder.path / f"{DYNAMIC}.f64")


def meaning_of(content: Content, component: str = "") -> str:
    """A hash of what was read: the same file by other columns, in another unit or as another motion has another one."""
    digest = hashlib.sha256(f"{_kind(content)} {component}".encode())
    if isinstance(content, MeasuredSet):
        digest.update(content.axis_unit.encode())
        digest.update(content.targets.tobytes())
        digest.update((content.deviations + 0.0).tobytes())
    elif isinstance(content, Recording):
        digest.update(f"{content.unit} {content.rate_hz!r}".encode())
        digest.update(content.values(0, min(len(content), MOST_COMPARED)).tobytes())
    else:
        digest.update(repr(content).encode())
    return digest.hexdigest()


def import_file(
    path: Path,
    store: Store,
    how: ReadOptions,
    utc: Callable[[], datetime] | None,
    *,
    at: StatementComparison | None = None,
    expected: str = "",
    accepted: Mapping[str, str] | None = None,
) -> tuple[ImportedFile, ...]:
    """Read a file and keep each measurement in it as a run of its own; the same one a second time is only named.

    ``at`` says with which site the file's statements are compared. ``expected`` is the sha256 it must have. The
    doubts of the readings are kept with them, those settled that ``accepted`` has a reason for, by code. The user's
    file is never changed. Raises what `read_all` and `settle` raise; FileFormatError (E-IMPORT-CHANGED) when the file
    changed meanwhile; StoreError.
    """
    at = at or StatementComparison()
    digest = content_hash(path)
    if expected and digest != expected:
        raise FileFormatError("E-IMPORT-CHANGED", str(path))
    maps = Maps(store.root)
    reads = tuple(_with_doubts(one, accepted or {}) for one in read_all(path, how, maps, utc))
    stated = at.settled([facts_of(path.name, header_of(reads[0].content))], maps, utc)
    return tuple(_import(path, store, one, digest, at=at, stated=stated) for one in reads)


def _with_doubts(read: ReadFile, accepted: Mapping[str, str]) -> ReadFile:
    """What was read with its doubts in the record; those that stop verdict and table, or would, are told."""
    across = read.component and read.component[1:2] != read.component[2:3]
    if not isinstance(read.content, MeasuredSet) or across:
        return read
    content = with_doubts(read.content, accepted)
    said = remarks(one for one in content.doubts if one.blocking or one.settled)
    return replace(read, content=content, notes=(*read.notes, *said))


def header_of(content: Content) -> Mapping[str, str]:
    """What a file states about itself; nothing of a gear's inspection."""
    return {} if isinstance(content, GearInspection | GearTraces) else content.header


def _import(
    path: Path, store: Store, read: ReadFile, digest: str, *, at: StatementComparison, stated: StatedFacts
) -> ImportedFile:
    if isinstance(read.content, GearTraces):
        raise FileFormatError("E-GEARFILE-IMPORT", str(path))
    kind, meaning = _kind(read.content), meaning_of(read.content, read.component)
    known = find_import(store, digest, meaning)
    folder = RunFolder(known) if known is not None else None
    if folder is None:
        said: dict[str, object] = {"name": path.name, "sha256": digest, "driver": read.driver}
        said |= {"notes": [one.as_data() for one in read.notes]}
        said |= {"component": read.component, "meaning": meaning}
        folder = store.create(at.name, {"imported": said, "site_file": ""})
        _keep(folder, path, read.content, digest)
        if stated.facts:
            folder.put(stages.STATED, stated)
        folder.set_state(STATE)
    return ImportedFile(
        run_id=folder.run_id,
        folder=folder.path,
        sha256=digest,
        kind=kind,
        new=known is None,
        notes=read.notes,
        component=read.component,
        stated=stated,
    )


def _kind(content: Content) -> str:
    if isinstance(content, Recording):
        return DYNAMIC
    return GEAR if isinstance(content, GearInspection) else MEASURED


def _keep(folder: RunFolder, path: Path, content: Content, digest: str) -> None:
    if isinstance(content, Recording):
        _stream(folder, content)
        unchanged = content_hash(path) == digest
    else:
        with disk_errors(path):
            data = path.read_bytes()
        unchanged = hashlib.sha256(data).hexdigest() == digest
        if unchanged:
            folder.write_bytes(f"source{path.suffix.lower()}", data)
            folder.put(_kind(content), content)
    if not unchanged:
        error = FileFormatError("E-IMPORT-CHANGED", str(path))
        folder.set_state("failed", error=error.as_record())
        raise error


def _stream(folder: RunFolder, content: Recording) -> None:
    """A dynamic record as plain doubles beside the run, piece by piece."""
    facts = StreamFacts(
        rate_hz=content.rate_hz, unit=content.unit, scale=1.0, trigger=content.trigger, header=dict(content.header)
    )
    with RawRecorder(folder.path, DYNAMIC, facts) as recorder:
        for block in content.blocks():
            recorder.append(block)
    folder.adopt(*folder.path.glob(f"{DYNAMIC}.*"))


def import_watched(path: Path, sha256: str, *, site: SiteFile, root: Path, now: datetime) -> str:
    """The runs that hold a file of a watched folder, imported by today's date. Raises as `import_file`."""
    how = ReadOptions(machine=site.site.name)
    found = import_file(path, Store(root), how, None, at=StatementComparison(site, utc=lambda: now), expected=sha256)
    return ", ".join(one.run_id for one in found)


def watcher_of(
    site: SiteFile,
    site_path: Path,
    folder: Path,
    *,
    utc: Callable[[], datetime],
    settle_s: float = 5.0,
    say: Say = silence,
) -> Watcher:
    """What watches a folder for a site: new files become runs of the site's store.

    By ``utc`` a date in a file is compared with today.
    """
    store = store_of(site, site_path)

    def take(path: Path, sha256: str) -> str:
        work = partial(import_watched, path, sha256, site=site, root=store.root, now=utc())
        return run_bounded(work, where=str(path))

    wanted = {f".{name}" for name in (*endings(), *OTHER_ENDINGS)} - {".gear-csv", ".md"}
    return Watcher(Folder(folder), WatchJournal(store.root), take, wanted, settle_s=settle_s, say=say)
