"""Screw files on the kernel's host: staged beside, taken over by one rename, the old one kept, the marker beside them.

The kernel reads a file once, when it starts. So after a rename the file and what acts differ until the restart: the
marker keeps in which life of the kernel a file was replaced, and as long as that lives the kept one is what acts.
"""

from __future__ import annotations

import hashlib
import json
import os
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drivers.linuxcnc.agent.kernel import KernelLife
from drivers.linuxcnc.agent.protocol import AgentRefusal

MARKER, NEW, BEFORE, ACTING = "trueflank-marker.json", ".new", ".before", ".acting"
MOST_BYTES = 1 << 20
SLACK_S = 1.0  # btime is whole seconds


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def write_durably(path: Path, data: bytes) -> None:
    """Bytes into a file by one rename: old or new, never a part; both on the disk when it returns."""
    beside = path.with_name(path.name + ".part")
    mode = path.stat().st_mode & 0o777 if path.exists() else 0o644
    handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, mode)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
        _sync(path.parent)
    except OSError as error:
        raise AgentRefusal("E-LCNC-FILE", file=str(path), why=str(error.strerror)) from error


def _sync(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def read_file(path: Path) -> bytes:
    """A file's bytes; b"" where there is none. Raises E-LCNC-FILE."""
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise AgentRefusal("E-LCNC-FILE", file=str(path), why=str(error.strerror)) from error
    if len(data) > MOST_BYTES:
        raise AgentRefusal("E-LCNC-FILE", file=str(path), why=f"it is larger than {MOST_BYTES} bytes")
    return data


class ScrewFiles:
    """All screw files of one machine. ``path_of`` names a joint's file; ``life`` is the kernel that runs now."""

    def __init__(
        self, folder: Path, path_of: Callable[[int], Path | None], life: Callable[[], KernelLife | None]
    ) -> None:
        self._folder, self._path_of, self._life = folder, path_of, life

    def path(self, joint: int) -> Path:
        """A joint's file. Raises E-LCNC-NO-FILE."""
        found = self._path_of(joint)
        if found is None:
            raise AgentRefusal("E-LCNC-NO-FILE", joint=joint)
        return found

    # ---- marker -----------------------------------------------------------------------------------

    def marker(self) -> dict[str, Any]:
        """What was kept last; a machine's name of its own is made at the first look. Raises E-LCNC-MARKER."""
        place = self._folder / MARKER
        if not place.exists():
            first = {"machine": uuid.uuid4().hex[:12], "transaction": 0, "state": "none", "head": 0, "joints": {}}
            self._keep({**first, "replaced": {}})
        try:
            found: dict[str, Any] = json.loads(read_file(place))
            found["transaction"], found["machine"], found["joints"], found["replaced"], found["state"]
        except (ValueError, KeyError, TypeError) as error:
            raise AgentRefusal("E-LCNC-MARKER", file=str(place)) from error
        return found

    def _keep(self, marker: dict[str, Any]) -> None:
        write_durably(self._folder / MARKER, json.dumps(marker, indent=1, sort_keys=True).encode())

    # ---- what stands and what acts ----------------------------------------------------------------

    def standing(self, joint: int) -> str:
        """The file that the next start reads."""
        return self._text(self.path(joint))

    def acting(self, joint: int) -> str:
        """The file that the running kernel read. Raises E-LCNC-EDITED when somebody changed it since."""
        path, life = self.path(joint), self._life()
        replaced = self.marker()["replaced"].get(str(joint))
        if life is not None and replaced is not None and replaced["life"] == life.name:
            self._ours(path, replaced)
            return self._text(path.with_name(path.name + ACTING))
        if life is not None and path.exists() and path.stat().st_ctime > life.began_s + SLACK_S:
            raise AgentRefusal("E-LCNC-EDITED", file=str(path))
        return self._text(path)

    def _ours(self, path: Path, replaced: dict[str, Any]) -> None:
        if _digest(read_file(path)) not in (replaced["digest"], replaced.get("was")):
            raise AgentRefusal("E-LCNC-EDITED", file=str(path))

    @staticmethod
    def _text(path: Path) -> str:
        try:
            return read_file(path).decode()
        except UnicodeDecodeError as error:
            raise AgentRefusal("E-LCNC-FILE", file=str(path), why="it is no text") from error

    def rights(self, joint: int) -> list[dict[str, str]]:
        """What the user who runs the agent may not do that a load of this joint needs; no file is touched."""
        path = self.path(joint)
        wanted = [(path, os.R_OK, "it cannot be read"), (path.parent, os.W_OK | os.X_OK, "nothing can be written here")]
        if path.parent != self._folder:
            wanted.append((self._folder, os.W_OK | os.X_OK, "nothing can be written here"))
        return [{"file": str(one), "why": why} for one, mode, why in wanted if not os.access(one, mode)]

    # ---- a transaction ----------------------------------------------------------------------------

    def begin(self, transaction: int, head: int, joints: list[int]) -> None:
        """Keep what stands in each file, then say in the marker what is under way; no file changes."""
        marker = self.marker()
        for joint in joints:
            path = self.path(joint)
            write_durably(path.with_name(path.name + BEFORE), read_file(path))
            path.with_name(path.name + NEW).unlink(missing_ok=True)
        kept = {str(joint): _digest(read_file(self.path(joint))) for joint in joints}
        self._keep({**marker, "transaction": transaction, "state": "in-progress", "head": head, "joints": kept})

    def _under_way(self, transaction: int, joint: int) -> dict[str, Any]:
        marker = self.marker()
        if (marker["transaction"], marker["state"]) != (transaction, "in-progress"):
            raise AgentRefusal("E-LCNC-OTHER", number=transaction, found=marker["transaction"], state=marker["state"])
        if str(joint) not in marker["joints"]:
            raise AgentRefusal("E-LCNC-OTHER", number=transaction, found=marker["transaction"], state="other joints")
        return marker

    def before(self, transaction: int, joint: int) -> str:
        """What stood before a transaction, as `begin` kept it. Raises E-LCNC-KEPT when it is not whole."""
        marker, path = self.marker(), self.path(joint)
        kept = path.with_name(path.name + BEFORE)
        if marker["transaction"] != transaction or marker["joints"].get(str(joint)) != _digest(read_file(kept)):
            raise AgentRefusal("E-LCNC-KEPT", number=transaction, file=str(kept))
        return self._text(kept)

    def put(self, transaction: int, joint: int, text: str) -> str:
        """A new file beside the one that stands; what is read back of it."""
        self._under_way(transaction, joint)
        new = self.path(joint).with_name(self.path(joint).name + NEW)
        write_durably(new, text.encode())
        return self._text(new)

    def commit(self, transaction: int, digests: dict[str, str]) -> None:
        """Each staged file takes the old one's place; the same again changes nothing. Raises E-LCNC-CHANGED.

        ``digests``: what must stand in the staged file of each joint. All are compared before any is renamed, and the
        old one must still be what `begin` kept.
        """
        staged = [self._staged(transaction, int(joint), digest) for joint, digest in digests.items()]
        for joint, path, new in staged:
            if new is not None:
                self._take_over(joint, path, new)

    def _staged(self, transaction: int, joint: int, digest: str) -> tuple[int, Path, bytes | None]:
        marker, path = self._under_way(transaction, joint), self.path(joint)
        stands = _digest(read_file(path))
        if stands == digest:
            return joint, path, None
        new = read_file(path.with_name(path.name + NEW))
        if _digest(new) != digest or stands != marker["joints"][str(joint)]:
            raise AgentRefusal("E-LCNC-CHANGED", file=str(path))
        return joint, path, new

    def _take_over(self, joint: int, path: Path, new: bytes) -> None:
        """First what acts is kept under this life's name, then one rename."""
        life, marker = self._life(), self.marker()
        acts, replaced = self.acting(joint), marker["replaced"]
        write_durably(path.with_name(path.name + ACTING), acts.encode())
        if life is not None:
            # Noted before the rename, with both: should we die between, what acts is known all the same.
            both = {"life": life.name, "digest": _digest(new), "was": _digest(read_file(path))}
            self._keep({**marker, "replaced": {**replaced, str(joint): both}})
        write_durably(path, new)
        path.with_name(path.name + NEW).unlink(missing_ok=True)

    def clear(self, joint: int, text: str) -> None:
        """A file that corrects nothing takes the old one's place, which is kept; the marker's transaction stays."""
        path = self.path(joint)
        write_durably(path.with_name(path.name + BEFORE), read_file(path))
        self._take_over(joint, path, text.encode())

    def finish(self, transaction: int, state: str) -> None:
        """Leave the marker in its last state."""
        marker = self.marker()
        if marker["transaction"] != transaction:
            raise AgentRefusal("E-LCNC-OTHER", number=transaction, found=marker["transaction"], state=marker["state"])
        self._keep({**marker, "state": state})
