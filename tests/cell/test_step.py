"""A known step of the optics at a cell: the operator puts a shim in where MSG says so, which proves the sense."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.errors import TrueflankError
from gateway.config import load_site
from gateway.domain.captures import Capture
from gateway.say import silence
from gateway.store import RunFolder
from gateway.workflow.errors21.measurement import measure_site
from gateway.workflow.run import stages
from simulators.cellfile import load_cell, with_plan
from tests.selftested import cell_running
from tests.sizes import long


@pytest.mark.parametrize("turned", [long(False), long(True)])
async def test_a_shim_proves_the_sense_of_a_straightness_set_up(tmp_path: Path, turned: bool) -> None:
    clock = LoopClock()
    async with cell_running(with_plan(load_cell("demo")), tmp_path, clock, wires="memory", block_s=0.5) as cell:
        cell.operator.change(mounts_reversed=("EXZ",) if turned else ())
        path = cell.site_path
        text = path.read_text(encoding="utf-8")
        assert 'component = "EXZ"\n' in text
        path.write_text(text.replace('component = "EXZ"\n', 'component = "EXZ"\nstep = 50.0\n'), encoding="utf-8")
        site = load_site(path)
        if turned:
            with pytest.raises(TrueflankError) as caught:
                await measure_site(site, path, clock=clock, say=silence, wanted=("EXZ",))
            assert (caught.value.code, caught.value.exit_code) == ("E-SETUP-STEP", 5)
            return
        done = await measure_site(site, path, clock=clock, say=silence, wanted=("EXZ",))
        capture = RunFolder(Path(done.run_folder)).get(stages.setup("EXZ-Z1"), Capture)
        assert capture.sense is not None
        assert capture.sense.scale == pytest.approx(1.0, abs=0.02)
        assert not any("EXZ-Z1" in str(line) for line in done.model.said)
        assert [line for line in cell.operator.log if line.startswith("stepped")] == [
            "stepped EXZ by 50",
            "stepped EXZ by 0",
        ]
