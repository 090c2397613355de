"""Corrections with their record: chain, refusal, undoing, re-compensation of files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.message import Message
from drivers.types.results import MeasuredSet
from drivers.types.sensing import Ambient
from gateway.domain.captures import Corrections
from gateway.errors import AmbientOutOfRange, ModelError
from gateway.evaluate.optics import air, corrections, displacement
from gateway.evaluate.optics.corrections import begin, describe_step, describe_steps, record_step, revert_step
from gateway.evaluate.optics.displacement import Compensation, recompensate, recompensated_set

REAL_START = Ambient(20.337280, 990.39005, 46.954897, (20.203292,))
REAL_END = Ambient(20.384956, 990.49346, 46.893887, (20.321342,))
AT = np.array([0.0, 250.0, 500.0, 1000.0])


def test_the_chain_says_what_by_whom_and_with_which_coefficients() -> None:
    record = record_step(begin("air"), "expansion", Message.stored("11.7 ppm/K, by the gateway"), ppm_per_k=11.7)
    assert [(item.step, item.by) for item in record.chain] == [("air", "instrument"), ("expansion", "gateway")]
    assert record.chain[1].coefficients == {"ppm_per_k": 11.7}
    assert record.details["expansion.ppm_per_k"] == 11.7
    assert tuple(map(str, describe_steps(record))) == (
        "air: by the instrument",
        "expansion: 11.7 ppm/K, by the gateway",
    )


@pytest.mark.parametrize("step", ["air", "expansion", "dead_path", "drift", "cosine", "abbe", "closure"])
def test_no_step_is_done_twice(step: corrections.Step) -> None:
    once = record_step(begin("nothing"), step, Message.stored("once"), x=1.0)
    with pytest.raises(ModelError, match="E-EVAL-TWICE") as caught:
        record_step(once, step, Message.stored("again"), x=1.0)
    assert "once" in caught.value.what
    assert describe_step(once, step) == Message.stored("once")


def test_only_the_instruments_own_step_can_be_taken_back_and_once() -> None:
    back = revert_step(begin("air"), "air", Message.stored("undone"))
    assert describe_step(back, "air") is None
    for wrong in (
        back,
        begin("nothing"),
        record_step(begin("nothing"), "air", Message.stored("edlen, by the gateway")),
    ):
        with pytest.raises(ModelError, match="E-EVAL-UNDO"):
            revert_step(wrong, "air", Message.stored("undone"))
    assert describe_step(record_step(back, "air", Message.stored("ciddor")), "air") == Message.stored("ciddor")


def test_records_stored_before_there_was_a_chain_are_still_refused_and_undone() -> None:
    old = Corrections(*map(Message.stored, ("by the instrument", "edlen, by the gateway", "none", "none")))
    assert old.dead_path is None
    with pytest.raises(ModelError, match="E-EVAL-TWICE"):
        record_step(old, "air", Message.stored("again"))
    assert describe_step(revert_step(old, "air", Message.stored("undone")), "air") is None
    with pytest.raises(ModelError, match="E-EVAL-UNDO"):
        revert_step(old, "expansion", Message.stored("undone"))


def real(factor: str = "0.31641096 0.31641067", **changes: object) -> MeasuredSet:
    x = np.stack([np.tile(np.array([0.0, 1.0, -2.0, 3.0])[:, None], (1, 5))] * 2, axis=2)
    header = {"Env factor": factor} if factor else {}
    return replace(MeasuredSet(AT, x, "mm", REAL_START, REAL_END, "air+material", 8.0, header), **changes)


def test_the_same_compensation_again_changes_nothing_but_the_files_rounding() -> None:
    found, record = recompensated_set(real(""), equation="edlen-1966")
    np.testing.assert_allclose(found, real().deviations, atol=1e-9)
    with_factor, _ = recompensated_set(real(), equation="edlen-1966")
    np.testing.assert_allclose(with_factor, real().deviations, atol=0.1 * AT.max() / 1000.0)
    steps = [(item.step, item.by, item.undone) for item in record.chain]
    assert steps == [
        ("air", "instrument", False), ("expansion", "instrument", False), ("air", "gateway", True),
        ("expansion", "gateway", True), ("air", "gateway", False), ("expansion", "gateway", False),
    ]  # fmt: skip


def test_another_expansion_coefficient_moves_lengths_by_its_share_from_the_datum() -> None:
    found, record = recompensated_set(real(""), equation="edlen-1966", expansion_ppm_per_k=11.7)
    off = (REAL_START.material_degc[0] + REAL_END.material_degc[0]) / 2.0 - 20.0
    expected = -(11.7 - 8.0) * off * AT / 1000.0
    np.testing.assert_allclose(found[:, 0, 0] - real().deviations[:, 0, 0], expected, atol=2e-5)
    assert "11.7" in str(record.expansion)


def test_a_sensor_read_wrong_is_put_right() -> None:
    found, _ = recompensated_set(real(""), equation="edlen-1966", material_degc=22.0)
    off = 22.0 - (REAL_START.material_degc[0] + REAL_END.material_degc[0]) / 2.0
    np.testing.assert_allclose(found[-1, 0, 0] - 3.0, -8.0 * off, atol=1e-3)


def test_one_degree_of_air_is_worth_what_the_reference_says() -> None:
    low = Ambient(19.0, 1013.25, 50.0)
    was, now = (
        Compensation(low, low, None),
        Compensation(replace(low, air_degc=20.0), replace(low, air_degc=20.0), None),
    )
    found, record = recompensate(np.zeros(2), [0.0, 1000.0], was, now, begin("air"), datum_mm=0.0)
    np.testing.assert_allclose(found, [0.0, 0.955], atol=2e-3)
    assert record.expansion is None
    with pytest.raises(ModelError, match="E-EVAL-UNDO"):
        recompensate(found, [0.0, 1000.0], was, now, record, datum_mm=0.0)


def test_what_cannot_be_recompensated_is_refused() -> None:
    with pytest.raises(ModelError, match="E-EVAL-UNDO"):
        recompensated_set(real(compensated_for="nothing"))
    with pytest.raises(ModelError, match="E-EVAL-ENV-FACTOR"):
        recompensated_set(real("0.31650000 0.31641067"))
    with pytest.raises(ModelError, match="E-EVAL-ENV-FACTOR"):
        recompensated_set(real("much"))
    with pytest.raises(AmbientOutOfRange, match="pressure_hpa"):
        recompensated_set(real("", ambient_start=replace(REAL_START, pressure_hpa=None)))
    assert displacement.stated_factor({}) is None


def test_all_28_index_values_of_nist_and_env_factors() -> None:
    table = (
        (20, 0, 101.325, 633, 271800, 271799), (20, 0, 60, 633, 160924, 160920), (20, 0, 120, 633, 321916, 321918),
        (50, 0, 100, 633, 243285, 243270), (5, 0, 100, 633, 282756, 282750), (-40, 0, 100, 633, 337580, 337471),
        (50, 100, 120, 633, 287924, 287864), (40, 75, 120, 633, 299418, 299406), (20, 100, 100, 633, 267394, 267394),
        (40, 100, 110, 1700, 270247, 270237), (20, 0, 101.325, 1700, 268479, 268483),
        (40, 100, 110, 300, 289000, 288922), (20, 0, 101.325, 300, 286581, 286579), (-40, 0, 120, 300, 427233, 427072),
    )  # fmt: skip
    for t, rh, kpa, nm, by_ciddor, by_edlen in table:
        assert air.ciddor(t, kpa * 1000.0, rh, nm) == pytest.approx(1 + by_ciddor * 1e-9, abs=1.01e-9)
        assert air.edlen(t, kpa * 1000.0, rh, nm) == pytest.approx(1 + by_edlen * 1e-9, abs=1.01e-9)
    for ambient, factor in ((REAL_START, 0.31641096), (REAL_END, 0.31641067)):
        was = Compensation(ambient, ambient, 8.0, "edlen-1966")
        assert was.half_wavelengths("test")[0] == pytest.approx(factor, rel=1e-7)
        assert replace(was, equation="edlen").half_wavelengths("test")[0] == pytest.approx(factor, rel=1e-7)
