"""Static memory, the hook at every block, and the mains failing at each of them."""

from __future__ import annotations

import dataclasses
import json

import pytest

from simulators.nck import AxisSpec, Nck
from tests.unit.nck.bench import MAIN, SPEC, Bench, eec_lines, enable, load_eec, on_bench
from tests.unit.nck.test_cec import encoder

OLD, NEW = [0.001] * 6, [0.002] * 6
PUSH = enable("X1", 0) + eec_lines("X1", NEW, 0.0, 10.0) + enable("X1", 1) + "M30"
BLOCKS = 3 + 2 + 6 + 3 + 1


async def test_static_memory_goes_through_a_file_into_another_control() -> None:
    kept: list[str] = []

    async def before(bench: Bench) -> None:
        await load_eec(bench, "X1", OLD, 0.0, 10.0)
        bench.nck.set("R[5]", 1.5, 7)
        bench.nck.set("GUDLIST[0]", 2.5, 7)
        bench.nck.set("$MA_MM_ENC_COMP_MAX_POINTS[0,Z1]", 70, 2)
        bench.load("R1=1\nM30 ; ä")
        bench.nck.select(MAIN)
        kept.append(json.dumps(bench.nck.static_memory()))

    async def after(bench: Bench) -> None:
        restored = Nck(bench.nck.spec, bench.clock)
        restored.restore_static_memory(json.loads(kept[0]))
        assert restored.get("$MA_MM_ENC_COMP_MAX_POINTS[0,Z1]") == 70
        assert restored.get("$AA_ENC_COMP[0,5,X1]") == 0.001
        assert (restored.get("R[5]"), restored.get("GUDLIST[0]"), restored.selected) == (1.5, 2.5, MAIN)
        assert restored.files.read(MAIN) == "R1=1\nM30 ; ä".encode("latin-1")
        await restored.start()
        assert [alarm.number for alarm in restored.alarms] == [6020], "the layout was changed before the power went"
        assert restored.get("$AA_ENC_COMP[0,5,X1]") == 0.0
        await restored.stop()

    async with on_bench(gud=(("GUDLIST", 3),)) as on:
        await before(on)
    async with on_bench(gud=(("GUDLIST", 3),)) as on:
        await after(on)


async def test_restored_tables_act_after_referencing_only() -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", OLD, 0.0, 10.0)
        content = json.loads(json.dumps(bench.nck.static_memory()))
        other = Nck(bench.nck.spec, bench.clock)
        other.restore_static_memory(content)
        await other.start()
        assert other.get("$MA_ENC_COMP_ENABLE[0,X1]") is True
        assert (other.axis_state("X1").referenced, other.axis_state("X1").eec_value) == (False, 0.0)
        other.reference_axis("X1")
        await bench.sleep(3.0)
        assert other.axis_state("X1").eec_value == pytest.approx(0.001)
        await other.stop()


async def test_another_controls_memory_is_refused() -> None:
    async with on_bench() as bench:
        content = bench.nck.static_memory()
        other = Nck(dataclasses.replace(SPEC, axes=(AxisSpec("Q1", "Q"),)), bench.clock)
        with pytest.raises(ValueError, match="another control"):
            other.restore_static_memory(content)
        with pytest.raises(ValueError, match="another control"):
            other.restore_static_memory({**content, "format": 99})


async def test_the_hook_sees_every_block_of_all_levels() -> None:
    async with on_bench() as bench:
        bench.load("R1=R1+1\nM17", "/_N_SPF_DIR/_N_L5_SPF")
        seen: list[int] = []
        bench.nck.on_block = seen.append
        await bench.run("\n; nothing\nL5\n/R3=1\nFOR R2=1 TO 2\nL5\nENDFOR\nM30")
        assert seen == list(range(1, len(seen) + 1))
        assert len(seen) == 1 + 2 + 1 + 1 + 2 * (1 + 2 + 1) + 1
        seen.clear()
        bench.nck.on_block = lambda block: seen.append(block) if block < 2 else bench.nck.channel_reset()
        await bench.run("R5=1\nR6=1\nR7=1\nM30")
        assert (seen, bench.nck.channel_status, bench.r(7)) == ([1], 0, 0.0)


@pytest.mark.parametrize("block", range(1, BLOCKS + 1))
async def test_mains_cut_at_every_block_of_a_push(block: int) -> None:
    async with on_bench() as bench:
        await load_eec(bench, "X1", OLD, 0.0, 10.0)
        bench.nck.power_cut_at_block(block)
        bench.press_start(PUSH)
        await bench.sleep(1.0)
        assert bench.nck.booting
        assert encoder(bench, "X1") == pytest.approx(0.0, abs=1e-6), "nothing compensates without reference"
        await bench.sleep(15.0)
        await bench.warm_up()
        points = [bench.nck.get(f"$AA_ENC_COMP[0,{n},X1]") for n in range(6)]
        written = min(max(block - 5, 0), 6)
        assert points == NEW[:written] + OLD[written:]
        enabled = bench.nck.get("$MA_ENC_COMP_ENABLE[0,X1]")
        assert enabled is (block < 1 or block >= 12), "a half table is never the one that is enabled"
        assert bench.nck.axis_state("X1").eec_value == (pytest.approx(points[0]) if enabled else 0.0)
