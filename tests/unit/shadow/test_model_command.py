"""`shadow --model`: the copy by a run's error model carries what no table can hold, X and C over stroke and turn."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from gateway.cli import app
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel, chain_of_errors
from gateway.shadow.reading import ProgramAxis, ProgramReader
from gateway.store import Store
from gateway.study.inputs import gear_of, load_gear
from gateway.workflow.tooth.shadowing import field_correction
from tests.interop.linuxcnc_host import ROOT
from tests.unit.report import closing
from tests.unit.web.test_model import GEAR

AXES = (
    ProgramAxis("X"),
    ProgramAxis("Y"),
    ProgramAxis("Z"),
    ProgramAxis("C", rotary=True, modulo=True),
)


def test_the_command_writes_the_copy_by_the_error_model(tmp_path: Path) -> None:
    text = (ROOT / "examples" / "sites" / "opcua-grinder.toml").read_text(encoding="utf-8")
    text = re.sub(r'(?m)^gear = ".*?"', 'gear = "gear.toml"', text)
    text = re.sub(r'(?m)^store = ".*?"', 'store = "runs"', text)
    text = re.sub(r"(?m)^height_mm = [0-9.]+", "height_mm = 5.0", text)
    site = tmp_path / "site.toml"
    site.write_text(text, encoding="utf-8")
    (tmp_path / "gear.toml").write_text(GEAR, encoding="utf-8")
    model: ErrorModel = closing.errors()
    run = Store(tmp_path / "runs").create("grinder", {"site_file": str(site)})
    run.put("errors", model)
    program = tmp_path / "cycle.mpf"
    height = 5.0
    ends = [(height - 4.0, 0.0), (height + 4.0, 0.0), (height - 4.0, 120.0), (height + 4.0, 120.0)]
    moves = [f"G1 X-160 Z{z:.3f} C=DC({c:.3f}) F3000" for z, c in ends]
    program.write_text("\n".join(["G500 G90 G94", "G0 X-170 Z100 C=DC(0)", *moves, "M30", ""]), encoding="utf-8")
    words = ["shadow", str(program), "--site", str(site), "--run", str(run.path), "--model", "--json"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    assert set(told["largest"]) >= {"X", "C"}
    copy = ProgramReader(AXES, frames={"G500": {}}).read((tmp_path / "cycle-corrected.mpf").read_text(), "copy")
    written = [one.move.end for one in copy if one.move is not None]

    # By another way: the field of the same model on the same machine, asked at the four ends.
    file = load_gear(tmp_path / "gear.toml")
    chain = chain_of_errors(model, height_mm=height)
    field = field_correction(Grinding(chain, gear_of(file), file.grinding.centre_distance_mm))
    added = []
    for z, c in ends:
        at = min(written, key=lambda one: abs(one["Z"] - z) + abs((one["C"] - c + 180.0) % 360.0 - 180.0))
        wanted = field({"X": -160.0, "Z": z, "C": c})
        assert at["X"] == pytest.approx(-160.0 + wanted["X"], abs=2e-6)
        assert (at["C"] - c + 180.0) % 360.0 - 180.0 == pytest.approx(wanted["C"], abs=2e-6)
        added.append(wanted["X"])
    # No sum of a table over Z and one over C has this: the mixed difference is not zero.
    assert abs(added[3] - added[2] - added[1] + added[0]) > 1e-5
    assert np.ptp(added) > 1e-4
