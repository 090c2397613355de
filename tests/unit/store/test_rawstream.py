"""A stream on disk: what was appended is there, after a kill too, and memory does not grow."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from drivers.recordings import RecordingGap
from gateway.errors import CorruptRecord, StoreError
from gateway.store.raw_stream import RawRecorder, StreamFacts, open_stream

FACTS = StreamFacts(50000.0, "um", 1000.0, 3, {"Axis": "X"})


def test_what_was_appended_is_there_with_its_gaps(tmp_path: Path) -> None:
    with RawRecorder(tmp_path, "c1", FACTS) as recorder:
        recorder.append(np.arange(5.0))
        recorder.append(np.arange(5.0, 9.0), lost=7)
    found = open_stream(recorder.path)
    np.testing.assert_array_equal(found.values(), np.arange(9.0) * 1000.0)
    assert (found.rate_hz, found.unit, found.trigger, found.gaps) == (50000.0, "um", 3, (RecordingGap(5, 7),))
    assert found.header["Axis"] == "X"


def test_a_stream_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    with RawRecorder(tmp_path, "c1", FACTS) as recorder:
        assert len(open_stream(recorder.path)) == 0
        recorder.append(np.ones(10))
        assert len(open_stream(recorder.path)) == 10


WRITES_UNTIL_KILLED = """
import sys
import numpy as np
from pathlib import Path
from gateway.store.raw_stream import RawRecorder, StreamFacts
recorder = RawRecorder(Path(sys.argv[1]), "c1", StreamFacts(1000.0, "um"))
block, count = np.arange(100.0), 0
while True:
    recorder.append(block + count, lost=1 if count else 0)
    count += 100
    print(count, flush=True)
"""


def test_after_a_kill_every_whole_sample_is_there(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITES_UNTIL_KILLED, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        said = [int(writer.stdout.readline()) for _ in range(50)][-1]
        os.kill(writer.pid, signal.SIGKILL)
        writer.stdout.read()
    with (tmp_path / "c1.f64").open("ab") as file:
        file.write(b"abc")  # a torn double
    with (tmp_path / "c1.gaps").open("a") as file:
        file.write("12")  # a torn line
    found = open_stream(tmp_path / "c1.f64")
    assert len(found) >= said
    np.testing.assert_array_equal(found.values(), np.arange(float(len(found))))
    assert found.gaps[:2] == (RecordingGap(100, 1), RecordingGap(200, 1))


def test_memory_stays_bounded_over_a_long_stream(tmp_path: Path) -> None:
    block = np.zeros(50_000)
    with RawRecorder(tmp_path, "c1", FACTS) as recorder:
        recorder.append(block)
        tracemalloc.start()
        for _ in range(100):
            recorder.append(block)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 200_000
    assert len(open_stream(recorder.path)) == 101 * 50_000


@pytest.mark.parametrize("text", ["{", "[]", '{"rate_hz": 0, "unit": "um", "scale": 1, "trigger": null, "header": {}}'])
def test_facts_that_make_no_sense_are_told(tmp_path: Path, text: str) -> None:
    with RawRecorder(tmp_path, "c1", FACTS) as recorder:
        recorder.append(np.ones(3))
    (tmp_path / "c1.json").write_text(text)
    with pytest.raises(CorruptRecord) as caught:
        open_stream(recorder.path)
    assert caught.value.code == "E-STORE-STREAM"


def test_an_existing_stream_is_never_overwritten(tmp_path: Path) -> None:
    RawRecorder(tmp_path, "c1", FACTS).close()
    with pytest.raises(StoreError):
        RawRecorder(tmp_path, "c1", FACTS)
