"""Dynamic captures: what is read is what was written, and what is damaged is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import TrueflankError
from drivers.files.rtx import RtxFormat
from drivers.recordings import Recording, RecordingGap

# The header of a genuine capture, key by key as its maker's program writes it.
HEAD = (
    "HEADER::\r\nFile type: rtx\r\nOwner: CARTO-Dynamic\r\nVersion no: 4.13.9237.28405\r\n\r\n"
    "TARGET DATA::\r\nFile Type: csv\r\nVelocity: 0\r\nSample rate: 50000\r\nSample no: {count}\r\n"
    "Trigger point: 0\r\nTrigger interval: 2e-05\r\nActual sample rate: 50000\r\nFlags: 0 1 2 0 2\r\n\r\n"
    "USER-TEXT::\r\nMachine: \r\nSerial No: \r\nDate: 10/02/2025 12:58:22\r\nBy: User\r\nAxis: \r\n"
    "Location: \r\n\r\nData:\r\n"
)


def written(path: Path, samples: np.ndarray, tail: bytes = b"EOF::\r\n", count: int | None = None) -> Path:
    head = HEAD.format(count=len(samples) if count is None else count)
    path.write_bytes(head.encode() + samples.astype("<f8").tobytes() + tail)
    return path


@pytest.mark.parametrize("tail", [b"EOF::\r\n", b"\r\nEOF::\r\n", b"\r\nEOF::"])
def test_a_genuine_header_is_read_with_and_without_a_line_end_before_the_end(tmp_path: Path, tail: bytes) -> None:
    samples = np.sin(np.arange(1001) / 50.0)
    found = RtxFormat("mm").read(written(tmp_path / "a.rtx", samples, tail))
    assert found.rate_hz == 50000.0
    assert found.duration_s == pytest.approx(0.02)
    assert found.header["Owner"] == "CARTO-Dynamic"
    assert found.header["Date"] == "10/02/2025 12:58:22"
    assert found.warnings == ()
    np.testing.assert_array_equal(found.values(), samples * 1000.0)


def test_a_cut_file_gives_what_is_there_and_says_so(tmp_path: Path) -> None:
    path = written(tmp_path / "a.rtx", np.arange(100.0), b"abc", count=200)
    found = RtxFormat("um").read(path)
    assert len(found) == 100
    assert "100 of 200" in str(found.warnings[0])


def test_more_after_the_last_sample_is_said(tmp_path: Path) -> None:
    path = written(tmp_path / "a.rtx", np.arange(100.0), count=50)
    found = RtxFormat("um").read(path)
    assert len(found) == 50
    assert "more after" in str(found.warnings[0])


def test_a_million_samples_are_mapped_not_loaded(tmp_path: Path) -> None:
    path = written(tmp_path / "a.rtx", np.linspace(0.0, 1.0, 1_000_001))
    found = RtxFormat("mrad").read(path)
    assert isinstance(found.raw, np.memmap)
    times, low, high = found.envelope(500)
    assert len(times) <= 500
    assert times[-1] <= 20.0
    assert np.all(low <= high)
    assert high[-1] == pytest.approx(206.2648, abs=1e-3)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ((b"HEADER::", b"HEATER::"), "E-FILE-DETECT"),
        ((b"Data:\r\n", b"Date:\r\n"), "E-FILE-RTX-DATA"),
        ((b"Sample no: 10", b"Sample no: 1O"), "E-FILE-RTX-VALUE"),
        ((b"Sample no: 10", b"Sample no: -3"), "E-FILE-RTX-VALUE"),
        ((b"Sample no: 10", b"Sample no: 2.5"), "E-FILE-RTX-VALUE"),
        ((b"Actual sample rate: 50000", b"Actual sample rate: 0"), "E-FILE-RTX-VALUE"),
    ],
)
def test_a_damaged_header_is_refused_in_words(tmp_path: Path, change: tuple[bytes, bytes], code: str) -> None:
    path = written(tmp_path / "a.rtx", np.arange(10.0))
    path.write_bytes(path.read_bytes().replace(*change))
    with pytest.raises(TrueflankError) as caught:
        RtxFormat("mm").read(path)
    assert caught.value.code == code


def test_a_sample_that_is_no_number_is_refused_by_its_place(tmp_path: Path) -> None:
    samples = np.arange(10.0)
    samples[7] = np.nan
    with pytest.raises(TrueflankError) as caught:
        RtxFormat("mm").read(written(tmp_path / "a.rtx", samples))
    assert (caught.value.code, caught.value.fields["sample"]) == ("E-FILE-RTX-SAMPLE", 7)


def test_the_unit_must_be_confirmed_and_known(tmp_path: Path) -> None:
    path = written(tmp_path / "a.rtx", np.arange(10.0))
    for unit, code in (("", "E-FILE-RTX-UNIT"), ("inch", "E-FILE-UNIT")):
        with pytest.raises(TrueflankError) as caught:
            RtxFormat(unit).read(path)
        assert caught.value.code == code


def test_no_samples_and_no_file_are_told(tmp_path: Path) -> None:
    for path, code in (
        (written(tmp_path / "a.rtx", np.zeros(0), count=5), "E-FILE-ROWS"),
        (tmp_path / "b", "E-FILE-READ"),
    ):
        if code == "E-FILE-ROWS":
            path.write_bytes(path.read_bytes()[: -len(b"EOF::\r\n")])
        with pytest.raises(TrueflankError) as caught:
            RtxFormat("mm").read(path)
        assert caught.value.code == code


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50), st.sampled_from(["mm", "um"]))
def test_what_is_written_is_read_again(
    tmp_path_factory: pytest.TempPathFactory, values: list[float], unit: str
) -> None:
    path = tmp_path_factory.mktemp("rtx") / "a.rtx"
    recording = Recording(np.asarray(values), 1000.0, "um", trigger=0, header={"Axis": "C"})
    RtxFormat(unit).write(path, recording)
    found = RtxFormat(unit).read(path)
    np.testing.assert_allclose(found.values(), values, rtol=1e-15, atol=1e-300)
    assert (found.rate_hz, found.header["Axis"], found.warnings) == (1000.0, "C", ())


def test_a_record_with_gaps_is_not_written_as_if_it_had_none(tmp_path: Path) -> None:
    recording = Recording(np.arange(10.0), 10.0, "um", gaps=(RecordingGap(4, 6),))
    with pytest.raises(TrueflankError) as caught:
        RtxFormat("um").write(tmp_path / "a.rtx", recording)
    assert caught.value.code == "E-FILE-RTX-GAPS"
    assert not (tmp_path / "a.rtx").exists()


def test_times_count_what_was_lost() -> None:
    recording = Recording(np.arange(10.0), 10.0, "um", gaps=(RecordingGap(4, 6), RecordingGap(8, 1)))
    assert recording.times()[[3, 4, 7, 8]] == pytest.approx([0.3, 1.0, 1.3, 1.5])
    assert recording.duration_s == pytest.approx(1.6)
    assert list(recording.stretches()) == [(0, 4), (4, 8), (8, 10)]
    times, low, high = recording.envelope(2)
    assert times == pytest.approx([0.2, 1.3])
    assert (low[1], high[1]) == (5.0, 9.0)


@given(st.binary(max_size=40), st.integers(0, 500))
def test_mutated_files_give_our_error_or_samples(
    tmp_path_factory: pytest.TempPathFactory, noise: bytes, at: int
) -> None:
    path = written(tmp_path_factory.mktemp("rtx") / "a.rtx", np.arange(20.0))
    data = path.read_bytes()
    path.write_bytes(data[:at] + noise + data[at + len(noise) :])
    try:
        found = RtxFormat("um").read(path)
    except TrueflankError:
        return
    assert np.isfinite(found.values()).all()
    assert len(found) >= 1
