"""Results kept on the disk by name, as long as the code that gave them is the same."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import TypeAdapter

ROOT = Path(__file__).parents[2]
RUN = ("gateway", "drivers", "simulators")
JUDGES = "families", "others", "machines", "runs", "judge", "tables", "identified", "record", "proposed", "trials"
T = TypeVar("T")


def state_of_code(root: Path = ROOT) -> str:
    """What all code and data that makes and judges a run is, in twelve letters; another after any change of them."""
    parts = [path for folder in RUN for path in (root / folder).rglob("*") if path.suffix in (".py", ".toml")]
    found = hashlib.sha256()
    for path in sorted([*parts, *(root / f"tests/closing/{name}.py" for name in JUDGES)]):
        found.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return found.hexdigest()[:12]


@dataclass(frozen=True)
class Kept(Generic[T]):
    """A folder of results of one kind, a JSON file each."""

    folder: Path
    kind: type[T]

    def get(self, name: str) -> T | None:
        """The result of that name, or None."""
        path = self._path(name)
        if not path.exists():
            return None
        return TypeAdapter(self.kind).validate_python(json.loads(path.read_bytes()))

    def all(self) -> list[T]:
        """Every result there is, by name."""
        names = sorted(path.stem for path in self.folder.glob("*.json"))
        return [one for name in names if (one := self.get(name)) is not None]

    def put(self, name: str, result: T) -> None:
        """Whole or not at all: a run may be killed at any instant."""
        path = self._path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_suffix(".part")
        beside.write_text(json.dumps(TypeAdapter(self.kind).dump_python(result)), encoding="utf-8")
        beside.replace(path)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.json"
