"""All runs below one folder: made, found by their ids, listed."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from itertools import islice
from pathlib import Path

from drivers.errors import words
from drivers.local.names import is_file_name, shown
from drivers.local.ownfiles import make_new_own_folder
from gateway.errors import StoreError, UnknownRun
from gateway.store import folder, records
from gateway.store.disk import disk_errors, write_whole
from gateway.store.folder import BESIDE, RUN_FILE, RunFolder, RunSummary, with_seal


def _utc_now() -> datetime:
    return datetime.now(UTC)


LATEST = "latest"
MEASURES = "measures"
"""Key of a plan: false in a run that can measure nothing, after which `latest` is still the run before it."""


@dataclass(frozen=True, slots=True)
class Needs:
    """What a command needs of a run: one stage whose name begins with one of ``stages`` (none: any run will do).

    ``code`` is the catalogue's text for it, ``made`` that of the command which makes it.
    """

    code: str
    stages: tuple[str, ...] = ()
    made: str = "W-MADE-BY-RUN"


ANYTHING = Needs("W-NEEDS-ANYTHING")


class Store:
    """All runs below one folder. Holds nothing open."""

    def __init__(self, root: Path, utc: Callable[[], datetime] = _utc_now) -> None:
        self.root = Path(root)
        self._utc = utc

    def create(self, site_name: str, plan: object = None) -> RunFolder:
        """A new run for a site; ``plan`` is any JSON-like value (mappings, lists, scalars) or text.

        Raises StoreError (E-STORE-DISK) when the folder cannot be made.
        """
        now = self._utc()
        slug = re.sub(r"[^A-Za-z0-9_-]+", "-", site_name).strip("-")[:40] or "run"
        run_id = f"{now.strftime('%Y%m%dT%H%M%S')}{now.microsecond // 1000:03d}Z-{slug}-{secrets.token_hex(2)}"
        path = self.root / run_id
        facts = {
            "schema": records.SCHEMA,
            "run_id": run_id,
            "site": site_name,
            "created_utc": now.isoformat(timespec="milliseconds"),
            "state": "created",
            "machine": {},
            "software": metadata.version("trueflank"),
            "plan": records.plain(plan),
            "stages": {},
            "files": {},
            BESIDE: {},
            folder.KEY: folder.TODAY,
            "errors": [],
        }
        with disk_errors(path):
            make_new_own_folder(path)
        write_whole(path / RUN_FILE, with_seal(facts))
        return RunFolder(path)

    def open(self, run: str | Path, needs: Needs = ANYTHING) -> RunFolder:
        """A run by its id, by the start of its id when only one matches, by its path, or `latest`.

        `latest` is the newest run that has what is needed. It passes over what measures nothing (self-test, rollback,
        recovery, disable): after one of these, who was about to push types `push latest` again.

        Raises UnknownRun (E-STORE-EMPTY, E-STORE-RUN, E-STORE-NEEDS), StoreError (E-STORE-LINK), CorruptRecord,
        FutureSchema.
        """
        found = self._run_by_name(run, needs)
        if not _has(found, needs):
            raise self._lacks(found.path, found.run_id, needs)
        return found

    def _lacks(self, where: Path, run: str, needs: Needs) -> UnknownRun:
        """What to do is to name another run where one has it, else to make it."""
        able = next((one for one in reversed(self._folders()) if _can_serve(one, needs)), None)
        step = words(needs.made) if able is None else words("W-STORE-OTHER", run=able.name)
        return UnknownRun("E-STORE-NEEDS", str(where), run=run, needs=words(needs.code), step=step)

    def _run_by_name(self, run: str | Path, needs: Needs) -> RunFolder:
        inside = (self.root / run,) if is_file_name(str(run)) else ()
        for path in (*inside, Path(run)):
            if (path / RUN_FILE).is_file():
                return RunFolder(path)
        folders = self._folders()
        matches = [path for path in folders if path.name.startswith(str(run))] if str(run) else []
        if str(run) == LATEST:
            return self._latest(folders, needs)
        if len(matches) == 1:
            return RunFolder(matches[0])
        if not folders:
            raise UnknownRun("E-STORE-EMPTY", str(self.root), step=words(needs.made))
        raise UnknownRun("E-STORE-RUN", str(self.root), run=shown(run), matches=len(matches))

    def _latest(self, folders: list[Path], needs: Needs) -> RunFolder:
        if not folders:
            raise UnknownRun("E-STORE-EMPTY", str(self.root), step=words(needs.made))
        able = (one for one in reversed(folders) if _measures(one) and _can_serve(one, needs))
        found = next(able, None if needs.stages else folders[-1])
        if found is None:
            raise self._lacks(self.root, LATEST, needs)
        return RunFolder(found)

    def runs(self) -> tuple[RunSummary, ...]:
        """All runs, oldest first; one that cannot be read is listed with its problem. Reads a file of each."""
        return tuple(self.summary(path.name) for path in self._folders())

    def summary(self, run_id: str) -> RunSummary:
        """The line of one run; one that cannot be read has its problem there."""
        path = self.root / run_id
        try:
            return RunFolder(path).summary()
        except StoreError as error:
            return RunSummary(run_id, path, state="unreadable", problem=str(error))

    def newest(self, most: int, before: str = "") -> tuple[str, ...]:
        """Ids of the newest runs, newest first, behind the id ``before``; no run is read. Raises StoreError."""
        names = (name for name in self._names() if not before or name < before)
        return tuple(islice((name for name in names if (self.root / name / RUN_FILE).exists()), most))

    def marks(self) -> dict[str, tuple[int, ...]]:
        """What changes whenever a run's own file does, by its id, oldest first; no run is read. Raises StoreError."""
        found: dict[str, tuple[int, ...]] = {}
        for name in reversed(self._names()):
            with contextlib.suppress(OSError):
                at = os.stat(self.root / name / RUN_FILE)
                found[name] = (at.st_mtime_ns, at.st_size, at.st_ino)
        return found

    def _names(self) -> list[str]:
        """Everything that may be a run, newest first: an id begins with its time."""
        with disk_errors(self.root):
            return sorted(os.listdir(self.root), reverse=True) if self.root.is_dir() else []

    def _folders(self) -> list[Path]:
        with disk_errors(self.root):
            return [self.root / name for name in reversed(self._names()) if (self.root / name / RUN_FILE).exists()]


def _has(folder: RunFolder, needs: Needs) -> bool:
    """Whether a run has one of the stages that are needed."""
    return not needs.stages or any(one.startswith(needs.stages) for one in folder.stages)


def _can_serve(path: Path, needs: Needs) -> bool:
    """The same of a run that may be unreadable: such a one is never taken for another's sake."""
    try:
        return not needs.stages or _has(RunFolder(path), needs)
    except StoreError:
        return False


def _measures(path: Path) -> bool:
    """Whether a run could measure something, also where it failed; one that cannot be read counts."""
    try:
        plan = RunFolder(path).plan
    except StoreError:
        return True
    return not isinstance(plan, Mapping) or plan.get(MEASURES) is not False
