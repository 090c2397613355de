"""The sign proof: measured on the machine, refused when in doubt, and the old table always comes back."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import run_virtual
from drivers.errors import BeamObstructed, TableError
from drivers.terms import TableKind
from drivers.types.orders import SignProof
from drivers.types.stops import Stop
from drivers.types.tables import LiveTable
from gateway.axes import AxisRecord
from gateway.errors import RollbackFailed, VerifyError, WriteRefused
from gateway.interlocks.facts import value_at
from gateway.interlocks.machine import proves
from gateway.push.sign_proof import prove_sign, prove_signs
from gateway.push.sign_proof_tables import (
    PEAK,
    MountedInstrument,
    SignQuestion,
    Steps,
    judge_steps,
    steps_from_readings,
    triangle,
)
from tests.unit.push.double import (
    MACHINE,
    NEVER,
    OLD,
    Bench,
    bench,
    changing,
    deadline,
    journals_of,
)

OLD_ON = LiveTable(OLD, enabled=True)


def prove(at: Bench, gain: float = -1.0, noise: float = 0.02, u: float = 0.05, **context: object) -> SignProof:
    rng = np.random.default_rng(3)

    async def read(_stop: Stop) -> tuple[float, float]:
        return 123.0 + gain * at.machine.compensation + float(rng.normal(0.0, noise)), u

    return run_virtual(
        lambda: prove_sign(replace(at.context, proof=None, **context), 0.0, 400.0, 50.0, lambda: nullcontext(read))
    )


@pytest.mark.parametrize("old", [OLD_ON, LiveTable(OLD, enabled=False), LiveTable(NEVER, enabled=False)])
def test_proved_and_restored(tmp_path: Path, old: LiveTable) -> None:
    at = bench(tmp_path, old)
    before = at.machine.live()
    proof = prove(at)
    assert (proof.machine, proof.kind, proof.output_axis, proof.sign) == (MACHINE, "axis", "X1", 1)
    assert proof.slope == pytest.approx(-1.0, abs=0.05)
    assert 0 < proof.slope_u < 0.05
    assert at.machine.live() == before
    assert at.machine.acting == old.table or not old.enabled
    assert at.machine.writes == ["sign-proof", "restore"]
    (found,) = journals_of(tmp_path)
    assert found.is_ended
    assert found.kinds[-1] == "ROLLED_BACK"
    assert "MEASURED" in found.kinds


@pytest.mark.parametrize(
    ("gain", "noise", "u", "code"),
    [
        (1.0, 0.02, 0.05, "E-PUSH-SIGN"),
        (0.0, 0.02, 0.05, "E-PUSH-NO-PROOF"),
        (-0.7, 0.02, 0.05, "E-PUSH-NO-PROOF"),
        (-1.3, 0.02, 0.05, "E-PUSH-NO-PROOF"),
        (-1.0, 0.02, 2.0, "E-PUSH-NO-PROOF"),
        *[(-0.5, 0.0, u, "E-PUSH-NO-PROOF") for u in (0.05, 0.3, 0.45, 0.55, 1.0, 2.0)],
        *[(-2.0, 0.0, u, "E-PUSH-NO-PROOF") for u in (0.05, 0.6, 1.2, 1.8, 1.85, 2.5)],
        (1.25, 0.0, 0.588, "E-PUSH-SIGN"),
        (-1.0, float("nan"), 0.05, "E-PUSH-NO-PROOF"),
        (-1.0, 0.02, float("nan"), "E-PUSH-NO-PROOF"),
    ],
)
def test_no_proof_in_doubt(tmp_path: Path, gain: float, noise: float, u: float, code: str) -> None:
    at = bench(tmp_path)
    if np.isnan(noise):
        noise, gain = 0.0, float("nan")
    with pytest.raises(VerifyError) as caught:
        prove(at, gain, noise, u)
    assert caught.value.code == code
    assert at.machine.own == OLD_ON


@pytest.mark.parametrize("kind", ["axis", "cross", "reversal"])
def test_a_step_is_judged_with_its_uncertainty_and_the_interlock_takes_what_was_proved(
    tmp_path: Path, kind: TableKind
) -> None:
    async def asked(slope: float, u: float) -> SignProof:
        return judge_steps(bench(tmp_path).context, Steps(slope * PEAK, u * PEAK, ()), kind)

    found = run_virtual(lambda: asked(-1.25, 0.16))
    assert (found.sign, found.slope, found.slope_u) == (1, pytest.approx(-1.25), pytest.approx(0.16))
    assert proves(found.slope, found.slope_u)
    for slope, u in (
        (-1.25, 0.12),
        (-0.75, 0.12),
        (-1.25, 0.32),
        (-0.7, 0.17),
        (-1.6, 0.35),
        (-0.5, 0.25),
        (-2.0, 0.5),
        (-1.0, np.nan),
    ):
        with pytest.raises(VerifyError) as caught:
            run_virtual(lambda slope=slope, u=u: asked(slope, u))
        assert caught.value.code == "E-PUSH-NO-PROOF"
        assert not proves(slope, u)


def test_whatever_the_uncertainty_a_proof_is_nearer_to_its_size_than_to_half_or_twice() -> None:
    sizes = np.round(np.arange(0.0, 3.0, 0.01), 2)
    taken = [size for size in sizes for u in np.linspace(0.0, 2.0, 401) if proves(-size, float(u))]
    assert (min(taken), max(taken)) == (pytest.approx(0.75), pytest.approx(1.5))


def test_a_lost_beam_restores_too(tmp_path: Path) -> None:
    at = bench(tmp_path)

    async def read(_stop: Stop) -> tuple[float, float]:
        raise BeamObstructed("E-CAP-BEAM", "laser", at_s=1.0)

    with pytest.raises(BeamObstructed):
        run_virtual(lambda: prove_sign(at.context, 0.0, 400.0, 50.0, lambda: nullcontext(read)))
    assert at.machine.own == OLD_ON


def test_refused_untouched(tmp_path: Path) -> None:
    at = bench(tmp_path)
    before = at.machine.live()
    at.machine.reserved = 3
    with pytest.raises(WriteRefused) as caught:
        prove(at, typed_name="other")
    assert "E-INT-POINTS" in str(caught.value)
    assert "E-INT-NAME" in str(caught.value)
    assert at.machine.live() == before
    assert "prepare_stops" not in at.controller.calls


def test_held_when_the_old_table_does_not_come_back(tmp_path: Path) -> None:
    at = bench(tmp_path)
    at.controller.faults[("read_back", 2, "after")] = deadline
    with pytest.raises(RollbackFailed) as caught:
        prove(at)
    assert "backup" in caught.value.fields
    assert not at.machine.own.enabled
    assert not journals_of(tmp_path)[0].is_ended


def test_a_table_that_never_becomes_active_is_no_proof(tmp_path: Path) -> None:
    at = bench(tmp_path, LiveTable(NEVER, enabled=False))
    at.machine.ignore_reset = True
    with pytest.raises(VerifyError) as caught:
        prove(at)
    assert caught.value.code == "E-PUSH-NO-PROOF"
    assert at.machine.own == LiveTable(NEVER, enabled=False)


def test_the_order_of_switching(tmp_path: Path) -> None:
    at = bench(tmp_path)
    seen: list[tuple[bool | None, float]] = []

    async def read(stop: Stop) -> tuple[float, float]:
        seen.append((stop.switch, stop.target))
        return -at.machine.compensation, 0.05

    at.controller.faults[("read_back", 9, "after")] = changing()
    run_virtual(lambda: prove_sign(at.context, 0.0, 400.0, 50.0, lambda: nullcontext(read)))
    assert [switch for switch, _place in seen] == [False, True] * 3
    assert len({place for _switch, place in seen}) == 1


@pytest.mark.parametrize(
    ("reference", "travel", "grid", "peak"),
    [
        (0.0, (0.0, 400.0), (0.0, 400.0, 50.0), 200.0),
        (400.0, (0.0, 400.0), (0.0, 400.0, 50.0), 200.0),
        (100.0, (0.0, 400.0), (0.0, 400.0, 50.0), 250.0),
        (120.0, (0.0, 400.0), (0.0, 400.0, 50.0), 250.0),
        (-50.0, (0.0, 400.0), (0.0, 400.0, 50.0), 200.0),
        (0.0, (-300.0, 300.0), (-300.0, 300.0, 25.0), -150.0),
        (0.0, (0.0, 90.0), (0.0, 400.0, 50.0), 50.0),
    ],
)
def test_triangle(
    tmp_path: Path, reference: float, travel: tuple[float, float], grid: tuple[float, float, float], peak: float
) -> None:
    at = bench(tmp_path)
    context = replace(at.context, axis=replace(at.context.axis, reference=reference, travel=travel))
    made, place = triangle(context, *grid)
    assert place == pytest.approx(peak)
    assert value_at(made, place) == pytest.approx(PEAK)
    assert max(map(abs, made.deviations)) == PEAK
    assert value_at(made, reference) == 0.0
    assert made.deviations[0] == made.deviations[-1] == 0.0


def test_rotary_triangle(tmp_path: Path) -> None:
    at = bench(tmp_path)
    axis = AxisRecord("C1", "C", "deg", True, True, (0.0, 360.0), 0.0, 1000.0, encoder=1)
    made, place = triangle(replace(at.context, axis=axis), 0.0, 360.0, 5.0)
    assert (place, made.index, made.modulo, made.deviation_unit) == (180.0, 1, True, "arcsec")


def test_no_triangle_on_two_points(tmp_path: Path) -> None:
    with pytest.raises(TableError) as caught:
        triangle(bench(tmp_path).context, 0.0, 400.0, 400.0)
    assert caught.value.code == "E-PUSH-TRIANGLE"


def test_uncertainty_is_the_larger_of_stated_and_seen() -> None:
    quiet = steps_from_readings([(0.0, 0.3), (3.0, 0.4)] * 3)
    assert quiet.mean == pytest.approx(3.0)
    assert quiet.u == pytest.approx(np.sqrt(3 * (0.09 + 0.16)) / 3)
    loud = steps_from_readings([(0.0, 0.0), (2.0, 0.0), (0.0, 0.0), (3.0, 0.0), (0.0, 0.0), (4.0, 0.0)])
    assert loud.u == pytest.approx(1.0 / np.sqrt(3))


@pytest.mark.parametrize("bad", range(6))
def test_one_reading_out_of_line_costs_as_many_steps_again_and_not_the_proof(tmp_path: Path, bad: int) -> None:
    at = bench(tmp_path)
    said: list[tuple[str, dict[str, object]]] = []
    first: list[Steps] = []
    count = 0

    async def read(_stop: Stop) -> tuple[float, float]:
        nonlocal count
        count += 1
        return -at.machine.compensation + (9.0 if count == bad + 1 else 0.0), 0.05

    def say(code: str, /, **fields: object) -> None:
        said.append((code, fields))

    question = SignQuestion(replace(at.context, say=say), 0.0, maximum=400.0, step=50.0, again=first.append)
    (found,) = run_virtual(lambda: prove_signs((question,), MountedInstrument(lambda: nullcontext(read))))
    assert isinstance(found, SignProof)
    assert found.slope == pytest.approx(-1.0)
    assert count == 12
    assert [len(one.each) for one in first] == [3]
    told = [fields for code, fields in said if code == "P-PUSH-SIGN-AGAIN"]
    assert [(one["count"], one["total"], one["mean"]) for one in told] == [(3, 6, round(first[0].mean, 3))]
    assert {fields["most"] for code, fields in said if code == "P-MOVE-SWITCHED"} == {6}
    (kept,) = journals_of(tmp_path)
    assert kept.kinds.count("MEASURED") == 1
    assert len(kept.latest("each")) == 6
    assert at.machine.own == OLD_ON


def test_steps_that_prove_at_once_are_not_repeated(tmp_path: Path) -> None:
    at = bench(tmp_path)
    count = 0

    async def read(_stop: Stop) -> tuple[float, float]:
        nonlocal count
        count += 1
        return -at.machine.compensation, 0.05

    run_virtual(lambda: prove_sign(at.context, 0.0, 400.0, 50.0, lambda: nullcontext(read)))
    assert count == 6


def test_six_steps_prove_what_scatters_and_none_is_proved_wrong() -> None:
    """Readings that scatter by 0.45 um, one of the first 8 um out of line: three steps prove nothing, six do."""
    rng = np.random.default_rng(11)
    open_at_three = open_at_six = 0
    for _ in range(2000):
        values = -PEAK * np.tile([0.0, 1.0], 6) + rng.normal(0.0, 0.45, 12)
        values[rng.integers(6)] += 8.0
        readings = [(float(value), 0.05) for value in values]
        if not steps_from_readings(readings[:6]).prove:
            open_at_three += 1
            found = steps_from_readings(readings)
            open_at_six += not found.prove
            assert not (found.prove and found.mean > 0)
    assert open_at_three == 2000
    assert open_at_six < 100
