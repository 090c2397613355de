"""Which life of the LinuxCNC kernel runs, as the process table tells it."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.linuxcnc.agent import kernel


def process(folder: Path, number: int, name: str, state: str, ticks: int) -> None:
    """A line of proc_pid_stat(5): the state is its third word, the start its 22nd."""
    (folder / str(number)).mkdir()
    rest = [state, *["0"] * 18, str(ticks), *["0"] * 20]
    (folder / str(number) / "stat").write_text(f"{number} ({name}) {' '.join(rest)}\n")


@pytest.mark.parametrize("state", ["Z", "X"])
def test_a_kernel_that_has_ended_is_no_life_though_it_is_still_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: str
) -> None:
    (tmp_path / "stat").write_text("cpu 0\nbtime 1000\n")
    process(tmp_path, 40, "milltask", state, 500)
    monkeypatch.setattr(kernel, "PROC", tmp_path)
    assert kernel.running_life() is None
    process(tmp_path, 41, "milltask", "S", 700)
    found = kernel.running_life()
    assert found is not None
    assert found.name == "41-700"
    assert 1000.0 < found.began_s < 1700.0
