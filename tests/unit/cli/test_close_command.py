"""`trueflank close` refuses before anything is opened or measured: name, work, inspection machine."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.errors import TrueflankError
from gateway.cli.machine.run import close_site_command
from simulators.cell.site import gear_text, site_text
from simulators.cellfile import load_cell, with_plan

NOWHERE = "opc.tcp://127.0.0.1:9"


def site_file(folder: Path, *, work: bool = True, inspector: bool = True) -> Path:
    cell = with_plan(load_cell("demo"))
    assert cell.part is not None
    (folder / "gear.toml").write_text(gear_text(cell.part), encoding="utf-8")
    urls = {one.name: "tcp://127.0.0.1:9" for one in cell.instruments}
    text = site_text(cell, "S-1", {"url": NOWHERE}, urls, "gear.toml" if work else "")
    lines = text.splitlines()
    kept = [line for line in lines if inspector or not line.startswith("inspector")]
    path = folder / "site.toml"
    path.write_text("\n".join(kept), encoding="utf-8")
    return path


def refused(site: Path, machine: str = "demo-grinder", *, apply: bool = True) -> str:
    with pytest.raises(TrueflankError) as caught:
        close_site_command(site, apply, machine, as_json=True)
    assert not (site.parent / "runs").exists()
    return caught.value.code


def test_what_is_missing_is_told_before_anything_is_opened(tmp_path: Path) -> None:
    assert refused(site_file(tmp_path), machine="another") == "E-RUN-NAME"
    assert refused(site_file(tmp_path, work=False)) == "E-CLOSE-WORK"
    assert refused(site_file(tmp_path, work=False), apply=False) == "E-CLOSE-WORK"
    assert refused(site_file(tmp_path, inspector=False)) == "E-INSPECT-INSPECTOR"
    site = site_file(tmp_path)
    (tmp_path / "gear.toml").unlink()
    assert refused(site) == "E-STUDY-READ"
