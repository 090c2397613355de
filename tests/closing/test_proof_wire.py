"""The closing run by the command line against cells in processes of their own, judged by the truth from outside."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.store import RunFolder
from gateway.tooth import ToothProposal
from gateway.workflow.run import stages
from simulators.grinding import draw_clamping
from simulators.grinding.grinder import rotation_axis_frame
from simulators.pytest_plugin import CellStarter, WireCell
from simulators.truth import Truth
from tests.closing.judge import SHARE, Machine, Places, kept_floor, places, rms
from tests.closing.machines import machine, written
from tests.closing.record import FLOOR_FACTOR

SPEED = 200.0
LONGEST_S = 3000


def true_flank(cell: WireCell, at: Places) -> np.ndarray:
    """The true flank of the part ground last at the judged places; of twice as many heights and one every second."""
    half = len(at.t) // 2
    told = cell.ask("flank", profile=2 * half, share=SHARE * (half - 0.5) / half, width=2 * len(at.z) + 1)
    np.testing.assert_allclose(told["t"], at.t, atol=1e-6)
    np.testing.assert_allclose(told["z"][1::2], at.z, atol=1e-9)
    return at.turned_off(np.asarray(told["surplus_um"])[:, :, 1::2])


def closed(cell: WireCell, name: str) -> dict[str, Any]:
    """What `trueflank close --apply` says as JSON."""
    tested = [sys.executable, "-m", "gateway.cli", "doctor", "self-test", str(cell.site)]
    subprocess.run(tested, capture_output=True, timeout=LONGEST_S, check=True)
    command = [sys.executable, "-m", "gateway.cli", "close", str(cell.site), "--apply", "--machine", name, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


@pytest.mark.soak
@pytest.mark.timeout(LONGEST_S + 300)
@pytest.mark.parametrize("seed", [101, 102, 107])
def test_a_machine_over_its_wires_ends_at_its_floor(seed: int, trueflank_cell: CellStarter, tmp_path: Path) -> None:
    from tests.closing.runs import grids_of

    file = machine(seed)
    truth = Truth(file)
    assert file.part is not None
    cell = trueflank_cell(written(file, tmp_path / "machine.toml"), speed=SPEED, options=("--plan",))
    told = closed(cell, file.site.name)
    at = places(file.part)
    after = rms(true_flank(cell, at))
    number = int(cell.ask("part")["ground"]["number"])
    seat = rotation_axis_frame(truth, file.part.grinding.height_mm).then(
        draw_clamping(file.part.clamping, file.seed, f"blank {number}")
    )
    judged = Machine(truth, file.part, seat, float(cell.ask("status")["clock_s"]))
    floor_um = kept_floor(judged, grids_of(cell.site)).rms_um
    folder = RunFolder(Path(told["run_folder"]))
    said = folder.get(stages.TOOTH, ToothProposal).prediction
    print(f"{file.name}: after {after:.3f}, floor {floor_um:.3f}, u {said.u_um:.3f}, {told['state']}")
    assert after <= np.hypot(FLOOR_FACTOR * floor_um, said.u_um)
