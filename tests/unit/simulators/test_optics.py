"""Instruments read what rigid bodies, light and air make them read: worked numbers."""

from __future__ import annotations

import numpy as np
import pytest

from simulators.cellfile import CellFile
from simulators.optics import LaserCounter, OpticsBench, RotaryReader, refractive_index
from simulators.optics.interferometer import saturation_pa
from simulators.truth import Truth
from tests.unit.simulators.motion import Motion, plain_cell

ARCSEC = np.pi / 180.0 / 3600.0
CALM = {"air_degc": {"start": 20.0}, "pressure_hpa": {"start": 1013.25}, "humidity_pct": {"start": 50.0}}


@pytest.mark.parametrize(
    ("degc", "hpa", "humidity", "wavelength", "index"),
    [
        (20.0, 1013.25, 0.0, 633.0, 1.000271800),
        (20.0, 600.0, 0.0, 633.0, 1.000160924),
        (20.0, 1200.0, 0.0, 633.0, 1.000321916),
        (50.0, 1000.0, 0.0, 633.0, 1.000243285),
        (5.0, 1000.0, 0.0, 633.0, 1.000282756),
        (-40.0, 1000.0, 0.0, 633.0, 1.000337580),
        (50.0, 1200.0, 100.0, 633.0, 1.000287924),
        (40.0, 1200.0, 75.0, 633.0, 1.000299418),
        (20.0, 1000.0, 100.0, 633.0, 1.000267394),
        (40.0, 1100.0, 100.0, 1700.0, 1.000270247),
        (40.0, 1100.0, 100.0, 300.0, 1.000289000),
    ],
)
def test_air_index_meets_published_values(
    degc: float, hpa: float, humidity: float, wavelength: float, index: float
) -> None:
    assert refractive_index(degc, hpa, humidity, wavelength) == pytest.approx(index, abs=1e-9)


def test_saturation_pressure_meets_the_manual() -> None:
    assert saturation_pa(34.0) == pytest.approx(5325.0, abs=0.5)


class Rig:
    """A laser or calibrator on a cell with given changes, following a motion."""

    def __init__(self, motion: Motion, component: str, **changes: object) -> None:
        self.truth = Truth(CellFile.model_validate(plain_cell(**changes)))
        self.bench = OpticsBench(self.truth, motion)
        self.setup = self.bench.setup_for(component, component[2])
        self.bench.mount(self.setup)
        first, second = self.truth.cell.instruments
        self.laser, self.calibrator = LaserCounter(first, self.bench), RotaryReader(second, self.bench)

    def displacement_mm(self, until: float) -> float:
        """Optical path counted from the start to the standing end, in mm of vacuum."""
        counts = self.laser.read(until).counts
        return float(counts[-1] - counts[0]) * self.laser.count_mm

    def index(self, t: float = 0.0) -> float:
        air = self.truth.climate.true(t)
        return refractive_index(air.air_degc, air.pressure_hpa, air.humidity_pct, 632.990577)


def jog(axis: str, start: float, end: float) -> Motion:
    return Motion(**{axis: [(0.0, start - 1.0), (0.5, start), (2.0, start), (4.0, end), (6.0, end)]})


def stops(*places: float, axis: str = "X1") -> Motion:
    knots: list[tuple[float, float]] = []
    for index, place in enumerate(places):
        knots += [(index * 4.0, place), (index * 4.0 + 3.0, place)]
    return Motion(**{axis: knots})


def moved(rig: Rig, motion: Motion) -> float:
    rig.laser.read(1.9)
    return rig.displacement_mm(6.0)


def test_the_laser_counts_the_optical_path() -> None:
    motion = jog("X1", 0.0, 1000.0)
    rig = Rig(motion, "EXX", climate=CALM)
    assert moved(rig, motion) / rig.index() == pytest.approx(1000.0, abs=2e-5)
    assert rig.laser.count_mm == pytest.approx(632.990577e-6 / 32.0)


def test_one_degree_of_air_makes_955_nm_per_metre() -> None:
    readings = []
    for degc in (20.0, 21.0):
        motion = jog("X1", 0.0, 1000.0)
        climate = CALM | {"air_degc": {"start": degc}}
        readings.append(moved(Rig(motion, "EXX", climate=climate), motion))
    assert (readings[0] - readings[1]) * 1e3 == pytest.approx(0.955, abs=0.04)


def test_the_scale_expands_with_its_temperature() -> None:
    data = plain_cell()
    data["axes"][0]["expansion_ppm_per_k"] = 11.7
    readings = []
    for degc in (20.0, 23.5):
        motion = jog("X1", 0.0, 1000.0)
        climate = CALM | {"material_degc": {"start": degc}}
        readings.append(moved(Rig(motion, "EXX", climate=climate, axes=data["axes"]), motion))
    assert (readings[1] - readings[0]) * 1e3 == pytest.approx(40.95, abs=0.05)


def test_the_dead_path_drifts_with_the_air() -> None:
    data = plain_cell()
    data["setups"][0]["dead_path_mm"] = 2000.0
    climate = CALM | {"air_degc": {"start": 20.0, "per_h": 1.0}}
    rig = Rig(Motion(), "EXX", climate=climate, setups=data["setups"])
    rig.laser.read(1.0)
    first = rig.laser.read(2.0).counts[-1]
    rig.laser.skip_to(3600.0)
    assert (rig.laser.read(3601.0).counts[-1] - first) * rig.laser.count_mm * 1e3 == pytest.approx(-1.909, abs=0.03)


def test_an_offset_line_reads_position_plus_abbe() -> None:
    data = plain_cell()
    data["setups"][0]["offset_mm"] = [0.0, 30.0, 200.0]
    pitch = [{"kind": "table", "positions": [0.0, 100.0], "values": [0.0, 5.0]}]
    yaw = [{"kind": "table", "positions": [0.0, 100.0], "values": [0.0, -4.0]}]
    own = [{"kind": "table", "positions": [0.0, 100.0], "values": [0.0, 2.0]}]
    motions = {"EXX": own, "EBX": pitch, "ECX": yaw}
    motion = jog("X1", 0.0, 100.0)
    rig = Rig(motion, "EXX", climate=CALM, setups=data["setups"], truth={"motions": motions})
    reading_um = (moved(rig, motion) / rig.index() - 100.0) * 1e3
    expected = 2.0 + 200e3 * 5.0 * ARCSEC + 30e3 * 4.0 * ARCSEC
    assert expected == pytest.approx(2.0 + 4.848 + 0.582, abs=1e-3)
    assert reading_um == pytest.approx(expected, abs=0.03)


def test_a_slanting_beam_reads_short() -> None:
    data = plain_cell()
    data["setups"][0]["misalign_mrad"] = [1.0, 0.0]
    motion = jog("X1", 0.0, 1000.0)
    rig = Rig(motion, "EXX", climate=CALM, setups=data["setups"])
    assert (moved(rig, motion) / rig.index() - 1000.0) * 1e3 == pytest.approx(-0.5, abs=0.03)


@pytest.mark.parametrize("sense", [1, -1])
def test_the_sense_turns_the_count(sense: int) -> None:
    data = plain_cell()
    data["instruments"][0]["sense"] = sense
    motion = jog("X1", 0.0, 10.0)
    rig = Rig(motion, "EXX", climate=CALM, instruments=data["instruments"])
    assert moved(rig, motion) == pytest.approx(sense * 10.0 * rig.index(), abs=1e-4)


def test_wrong_optics_do_not_follow_a_move() -> None:
    motion = jog("X1", 0.0, 10.0)
    rig = Rig(motion, "EXX", climate=CALM)
    rig.bench.mount(rig.setup, "angular")
    assert abs(moved(rig, motion)) < 1e-3


def test_angular_optics_read_the_angle() -> None:
    data = plain_cell()
    pitch = {"component": "EBX", "axis": "X", "instrument": "laser", "optics": "angular"}
    motion = jog("X1", 0.0, 100.0)
    terms = [{"kind": "table", "positions": [0.0, 100.0], "values": [0.0, 60.0]}]
    rig = Rig(motion, "EBX", setups=[*data["setups"], pitch], truth={"motions": {"EBX": terms}})
    assert moved(rig, motion) == pytest.approx(30.0 * np.sin(60.0 * ARCSEC), abs=4e-5)


def test_a_broken_beam_stands_still_and_what_was_missed_stays_missed() -> None:
    motion = jog("X1", 0.0, 10.0)
    rig = Rig(motion, "EXX", climate=CALM)
    rig.laser.read(2.5)
    rig.bench.broken.add("laser")
    held = rig.laser.read(5.0).counts
    assert np.all(held == held[0])
    rig.bench.broken.clear()
    assert abs(int(rig.laser.read(6.0).counts[-1]) - int(held[0])) <= 1


def test_nothing_is_dropped_and_nothing_comes_twice() -> None:
    rig = Rig(Motion(), "EXX")
    pieces = [rig.laser.read(t).sequence for t in (0.0101, 0.0102, 0.5, 0.5, 3.21)]
    assert np.array_equal(np.concatenate(pieces), np.arange(3211))


def test_each_stop_has_its_own_offset_and_two_in_a_run_are_off() -> None:
    data = plain_cell()
    noise = {"stop": 0.1, "outliers": {"count": 2, "size": 5.0, "every": 30}}
    data["instruments"][0]["noise"] = noise
    places = [float(20 * (index % 2)) for index in range(60)]
    rig = Rig(stops(*places), "EXX", climate=CALM, instruments=data["instruments"])
    counts = rig.laser.read(240.0)
    at = [int(np.searchsorted(counts.sequence, 1000.0 * (4.0 * index + 2.0))) for index in range(60)]
    reading = counts.counts[at] * rig.laser.count_mm / rig.index()
    errors = (reading - reading[0] - np.asarray(places) + places[0]) * 1e3
    assert np.sum(np.abs(errors) > 4.0) == 4
    usual = errors[np.abs(errors) < 4.0]
    assert 0.06 < np.std(usual) < 0.16


def rotary(motion: Motion, **calibrator: object) -> Rig:
    data = plain_cell()
    data["instruments"][1] |= calibrator
    return Rig(motion, "ECC", instruments=data["instruments"])


def test_with_the_device_held_the_laser_reads_the_axis() -> None:
    for sense in (1, -1):
        rig = rotary(jog("C1", 0.0, 0.1), sense=sense)
        rig.calibrator.read(1.5)
        rig.calibrator.hold()
        turns = rig.calibrator.read(6.0)
        assert turns.laser_deg[-1] - turns.laser_deg[0] == pytest.approx(sense * 0.1, abs=1e-9)
        assert np.ptp(turns.device_deg) == 0.0
        assert turns.beam.all()


def test_the_device_turning_alone_moves_both_readings_alike() -> None:
    rig = rotary(Motion())
    rig.calibrator.read(1.0)
    rig.calibrator.turn(-0.1)
    assert rig.calibrator.turning
    turns = rig.calibrator.read(3.0)
    assert not rig.calibrator.turning
    assert turns.device_deg[-1] == pytest.approx(-0.1, abs=1e-9)
    assert turns.laser_deg[-1] == pytest.approx(-0.1, abs=1e-9)


def test_axis_is_laser_minus_device_over_whole_turns() -> None:
    motion = Motion(C1=[(0.0, 0.0), (1.0, 0.0), (80.0, 790.0), (85.0, 790.0), (120.0, 500.0)])
    rig = rotary(motion, remainder_deg=0.05)
    turns = rig.calibrator.read(130.0)
    assert turns.beam.all()
    assert turns.laser_deg[-1] - turns.device_deg[-1] == pytest.approx(500.0, abs=1e-7)
    middle = int(83.0 * 100)
    assert turns.laser_deg[middle] - turns.device_deg[middle] == pytest.approx(790.0, abs=1e-7)
    assert 1e-4 < abs(turns.laser_deg[-1]) <= 0.05


def test_the_modulo_axis_counts_on_over_360() -> None:
    class Wrapped(Motion):
        def encoder(self, axis: str, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            position, direction = super().encoder(axis, times)
            return np.mod(position, 360.0), direction

    rig = rotary(Wrapped(C1=[(0.0, 350.0), (1.0, 350.0), (6.0, 400.0)]))
    turns = rig.calibrator.read(8.0)
    assert turns.laser_deg[-1] - turns.device_deg[-1] == pytest.approx(50.0, abs=1e-7)


def test_beyond_ten_degrees_the_beam_is_lost_until_a_new_datum() -> None:
    rig = rotary(Motion(C1=[(0.0, 0.0), (1.0, 0.0), (4.0, 30.0), (7.0, 0.0)]))
    rig.calibrator.read(0.5)
    rig.calibrator.hold()
    turns = rig.calibrator.read(8.0)
    lost = int(np.argmin(turns.beam))
    assert turns.time_s[lost] == pytest.approx(2.0, abs=0.02)
    assert not turns.beam[lost:].any()
    rig.calibrator.restore_beam()
    assert rig.calibrator.read(9.0).beam.all()


def test_a_device_that_is_too_slow_loses_the_beam() -> None:
    rig = rotary(Motion(C1=[(0.0, 0.0), (1.0, 0.0), (2.0, 90.0)]), turn_deg_per_s=25.0)
    assert not rig.calibrator.read(3.0).beam[-1]


def test_wrong_optics_on_the_calibrator_read_nothing() -> None:
    rig = rotary(jog("C1", 0.0, 0.1))
    rig.bench.mount(rig.setup, "linear")
    rig.calibrator.read(1.5)
    rig.calibrator.hold()
    assert abs(rig.calibrator.read(6.0).laser_deg[-1]) < 1e-9


def test_the_calibrator_reads_every_error_that_turns_it() -> None:
    data = plain_cell()
    data["setups"][2] |= {"eccentric_mm": 1.0}
    ecc = [{"kind": "harmonic", "order": 1, "amplitude": 8.0, "phase_deg": -90.0}]
    yaw = [{"kind": "constant", "value": 40.0}]
    motion = Motion(C1=[(0.0, 0.0), (1.0, 0.0), (10.0, 90.0), (12.0, 90.0)])
    rig = Rig(motion, "ECC", setups=data["setups"], truth={"motions": {"ECC": ecc, "ECX": yaw}})
    turns = rig.calibrator.read(12.0)
    axis = (turns.laser_deg - turns.device_deg)[-1] - (turns.laser_deg - turns.device_deg)[0]
    assert (axis - 90.0) * 3600.0 == pytest.approx(8.0 - 0.5, abs=1e-4)


def test_the_device_brings_its_own_error() -> None:
    own = [{"kind": "harmonic", "order": 1, "amplitude": 0.3}]
    rig = rotary(Motion(C1=[(0.0, 0.0), (1.0, 0.0), (16.0, 180.0), (18.0, 180.0)]), own_error=own)
    turns = rig.calibrator.read(18.0)
    axis = turns.laser_deg - turns.device_deg
    assert (axis[-1] - axis[0] - 180.0) * 3600.0 == pytest.approx(-0.6, abs=1e-3)


def test_senses_are_drawn_by_the_seed_and_reproducible() -> None:
    data = plain_cell()
    data["instruments"][0]["sense"] = "seed"
    cell = CellFile.model_validate(data)
    drawn = [LaserCounter(cell.instruments[0], OpticsBench(Truth(cell, seed), Motion())).sense for seed in range(20)]
    again = [LaserCounter(cell.instruments[0], OpticsBench(Truth(cell, seed), Motion())).sense for seed in range(20)]
    assert drawn == again
    assert set(drawn) == {1, -1}
