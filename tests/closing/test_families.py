"""Closing runs on machines beyond the class, family by family: nothing gets worse, and what was predicted comes true.

`make test` tries on a true machine what is proposed to it, `make long` on those of four more families, and sends one
through a short run. `make soak N=20`, or `make families N=20` alone, takes so many of each family (20 at most): each is
tried on its truth and goes through a short run, one of each family through a whole one. It judges how honest their
uncertainties are, and writes docs/families.md.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.store import RunFolder
from gateway.workflow.run import stages
from tests.closing.families import FAMILIES, relative
from tests.closing.honestpage import write
from tests.closing.honesty import broken as dishonest
from tests.closing.honesty import spreads
from tests.closing.kept import Kept, state_of_code
from tests.closing.others import other
from tests.closing.pool import Job, prove
from tests.closing.proof import machine_row
from tests.closing.proposed import tried
from tests.closing.record import MachineResult
from tests.closing.runs import quick, run_machine
from tests.closing.told import unfit
from tests.closing.trials import FEW, OTHER, Trial, harmed, of_trials, try_all
from tests.sizes import few, soak

ROOT = Path(__file__).parents[2]
DOCS, KEPT = ROOT / "docs", ROOT / ".families"
WORKERS = 2
MOST = 20  # of a family
TRIED = ("tilting", "coarse", "noisy")
DEFAULT = 1  # of these in `make test`; four more in `make long`, the others in `make soak`
REPORTED = TRIED[0]  # its report is written and read; drawing takes as long again as all the rest
LEAST = 0.3
SURE = 2.0


def broken(one: MachineResult) -> list[str]:
    """What a machine of any family is held to, by its truth.

    C may deviate more as an axis, on purpose: a table of its own works for the tooth then.
    """
    if one.failed:
        return [f"{one.name}: {one.failed}"]
    said = [f"{one.name}: the flank got worse"] if one.after_um > one.set_right_um + SURE * one.u_um else []
    said += [f"{one.name}: the flank is said to be worse"] if one.outcome == "worse" else []
    off = (one.points.squares / one.points.count) ** 0.5
    said += [f"{one.name}: {off:.2f} u from what was predicted"] if off > SURE else []
    linear = {axis: pair for axis, pair in one.axes.items() if axis != "C1"}
    return said + [f"{one.name}: M of {axis} from {m} to {n}" for axis, (m, n) in linear.items() if n > m + LEAST]


@pytest.mark.parametrize("family", few([*TRIED, *(one for one in FAMILIES if one not in TRIED), OTHER], DEFAULT, 4))
async def test_what_is_proposed_to_a_machine_of_a_family_makes_it_better(tmp_path: Path, family: str) -> None:
    """The smaller one of a closing run: from files, nothing is written, and the truth grinds with the tables."""
    file = other(1) if family == OTHER else relative(family, 1, FEW)
    found = await tried(file, tmp_path, report=family == REPORTED)
    print(found)
    assert found.after_um < 0.8 * found.before_um
    assert found.missed_um < SURE * found.u_um
    assert all(after < before + LEAST for before, after in found.axes.values())
    assert unfit(found.run) == []


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("family", ["noisy", soak("wearing"), soak("coarse")])
def test_a_short_run_on_a_machine_of_a_family(tmp_path: Path, family: str) -> None:
    """On a disc of few lobes; every file that it leaves is fit to be read."""
    file = relative(family, 1, FEW)
    found = run_machine(file, file.seed, tmp_path, short=True, edit=quick)
    print(found)
    assert broken(found) == []
    assert found.after_um <= found.limit_um
    assert found.after_um < 0.7 * found.set_right_um
    (run,) = (path.parent for path in tmp_path.rglob("run.json"))
    assert RunFolder(run).has(stages.TOOTH_VERDICT)
    assert unfit(run) == []


@pytest.mark.soak
@pytest.mark.timeout(0)
def test_machines_of_families_get_better_and_their_uncertainties_are_honest(tmp_path: Path) -> None:
    """One of each family at a time, so that the page, written anew after every machine, tells of all of them early.

    Trials come first: they are short. What was found is kept in .families while the code stays as it is.
    """
    count = min(int(os.environ.get("TRUEFLANK_MACHINES", "20")), MOST)
    wanted = families_jobs(count)
    command = "make families" if count == MOST else f"make families N={count}"
    page = Path(os.environ.get("TRUEFLANK_PROOF") or DOCS)
    found: dict[str, list[MachineResult]] = {family: [] for family in FAMILIES}

    trials: list[Trial] = []

    def told(one: Trial) -> None:
        trials.append(one)
        write(found, page, command, len(wanted), trials)

    def heard(one: MachineResult) -> None:
        print(machine_row(one), flush=True)
        found[one.name.rsplit("-", 1)[0]].append(one)
        write(found, page, command, len(wanted), trials)

    kept = KEPT / state_of_code()
    tries = [(family, seed) for seed in range(1, count + 1) for family in (*FAMILIES, OTHER)]
    try_all(tries, tmp_path, WORKERS, Kept(kept / "trials", Trial), told)
    results = prove(wanted, tmp_path, WORKERS, heard, Kept(kept, MachineResult))
    assert [line for one in trials for line in harmed(one)] == []
    assert dishonest(of_trials({"all": trials})) == []
    assert [line for one in results for line in broken(one)] == []
    assert dishonest(spreads(found)) == []


def families_jobs(count: int) -> list[Job]:
    """Short runs on the disc of few lobes, one of each family at a time, and at last a whole one of each family."""
    short = [Job(seed, family=family, gear=FEW, short=True) for seed in range(2, count + 1) for family in FAMILIES]
    return [*short, *(Job(1, family=family) for family in FAMILIES)]


def test_what_no_reader_should_meet_is_found(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    (run / "fit.json").write_text(
        '{"n": 1.5, "word": "information, none", "site_file": "../../site.toml"}', encoding="utf-8"
    )
    (run / "fit.html").write_text("<path d='nan'/><p>in range</p>", encoding="utf-8")
    assert unfit(run) == []
    (run / "a.json").write_text('{"n": NaN, "m": -Infinity}', encoding="utf-8")
    (run / "b.html").write_text("<p>U is None, M inf</p>", encoding="utf-8")
    (run / "c.txt").write_text(f"kept in {tmp_path}/runs/one", encoding="utf-8")
    assert [line.split(":")[0] for line in unfit(run)] == ["a.json", "a.json", "b.html", "b.html", "c.txt"]


def test_families_differ_in_what_makes_them_hard() -> None:
    files = {family: relative(family, 1) for family in FAMILIES}
    assert len({file.truth.model_dump_json() + file.machine.model_dump_json() for file in files.values()}) == len(files)
    assert relative("worn", 1) == files["worn"] != relative("worn", 2)
    assert all(axis.scatter > 0.1 for axis in files["noisy"].axes if axis.measure)
    assert {axis.encoder for axis in files["second"].axes if axis.measure} == {1}
    assert files["wearing"].wheel.wear_um > 0.0
    assert any(max(one.offset_mm) >= 60.0 for one in files["abbe"].setups)
