"""The written lists of questions, read from the files beside this one."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources
from typing import Any

from drivers.probes import Probe
from drivers.sinumerik.opcua.session import nodes

OURS = f"{nodes.FILE_SYSTEM}/Part Program/TFPROBE.MPF"
LISTS = ("server", "programs", "values")


@cache
def written_probes() -> tuple[Probe, ...]:
    """All questions in the order in which they are asked."""
    folder = resources.files("drivers.sinumerik.opcua.probing")
    found: list[Probe] = []
    for name in LISTS:
        tree = tomllib.loads(folder.joinpath(f"{name}.toml").read_text(encoding="utf-8"))
        found += [_probe(key, entry) for key, entry in tree.items()]
    return tuple(found)


def _probe(name: str, entry: dict[str, Any]) -> Probe:
    return Probe(**{**entry, "name": name, "ask": tuple(entry["ask"])})
