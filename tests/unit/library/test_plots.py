"""Every result of the library draws itself: each panel has axes that name their units, and data of its own."""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image

import trueflank as tf
from tests.unit.cli import test_process_commands as process
from tests.unit.cli.test_transmission_command import made

ROOT = Path(__file__).parents[3]
FILE = ROOT / "tests" / "golden" / "files" / "basic.rtl"
GEAR = tf.Gear.of(rp=36.0, rrp=2.5, a=1.5, zp=12, zc=11, b=10.0, centre_distance=120.0)
MACHINE = tf.Machine({"EXC": 0.5, "ECC": {"type": "fourier", "a": [0.0, 3.0]}})
UNIT = re.compile(r"mm|µm|deg|arcsec|Nm|share of their sum")
NOTHING_TO_DRAW = {"FrameOf", "TrueflankError", "Study"}
"""A frame is in its machine's picture, an error is a text; the paper's test draws a whole study."""


@functools.cache
def _drive() -> tf.Drive:
    return tf.transmission(tf.Reducer.of(GEAR, datum="bore"), tf.flank(MACHINE, GEAR), steps=24)


def _matched() -> tf.Matched:
    waves = ([3.0], [0.0, 3.0], [1.0, 1.0])
    parts = [tf.flank(tf.Machine({"ECC": {"type": "fourier", "a": one}}), GEAR) for one in waves]
    return tf.match(tf.Reducer.of(GEAR, datum="bore"), parts, marks=[1, 6], steps=24)


def _bench(path: Path) -> tf.DriveTest:
    return tf.read_bench(made(path / "bench.csv"), pins=40, ratio=121.0)


def _separated(path: Path) -> tf.Separated:
    columns = {name: int(word) if word.isdigit() else float(word) for name, word in map(_pair, process.COLUMNS)}
    return tf.separate(process.part(path / "a.csv"), tf.Gear.load(process.gear_file(path)), columns=columns)


def _pair(word: str) -> tuple[str, str]:
    name, _, value = word.partition("=")
    return name, value


RESULTS: dict[str, Callable[[Path], Any]] = {
    "Contact": lambda _: tf.contact(MACHINE, GEAR, heights=[-4.0, 4.0], points=21).plot(),
    "Corrected": lambda _: tf.correct(MACHINE, GEAR).plot(),
    "Drive": lambda _: _drive().plot(),
    "DriveTest": lambda path: _bench(path).plot(),
    "ErrorMotion": lambda _: tf.fit(tf.read(FILE), "EXX").plot(),
    "Evaluated": lambda _: tf.evaluate(tf.read(FILE)).plot(),
    "EvaluatedDrive": lambda path: tf.evaluate(_bench(path)).plot(),
    "Flank": lambda _: tf.flank(MACHINE, GEAR).plot(),
    "Gear": lambda _: GEAR.plot(),
    "Machine": lambda _: MACHINE.plot(),
    "Matched": lambda _: _matched().plot(),
    "Measured": lambda _: tf.read(FILE).plot(),
    "Profile": lambda _: GEAR.profile(21, space=2).plot(),
    "Ranking": lambda _: tf.rank(MACHINE, GEAR, trajectories=3).plot(),
    "Reducer": lambda _: tf.Reducer.of(GEAR, datum="bore").plot(),
    "RelativeError": lambda _: MACHINE.relative_error("dy").plot(X=-120.0, Z=0.0, C=[0.0, 90.0]),
    "RelativeErrors": lambda _: MACHINE.relative(X=-120.0, Z=0.0, C=[0.0, 90.0]).plot(),
    "Separated": lambda path: _separated(path).plot(),
    "Surface": lambda _: tf.flank(MACHINE, GEAR).surface().plot(),
    "Wheel": lambda _: GEAR.wheel(21).plot(),
}


def test_every_kind_of_result_is_here() -> None:
    kinds = {name for name in tf.__all__ if isinstance(getattr(tf, name), type)}
    assert kinds - NOTHING_TO_DRAW == set(RESULTS)
    assert all(hasattr(getattr(tf, name), "plot") for name in (*RESULTS, "Study"))


@pytest.mark.parametrize("name", sorted(RESULTS))
def test_a_result_draws_itself_with_units(name: str, tmp_path: Path) -> None:
    figure = RESULTS[name](tmp_path)
    panels = [one for one in figure.axes if hasattr(one, "zaxis") or (one.axison and one.has_data())]
    assert panels
    for panel in panels:
        said = " ".join([panel.get_xlabel(), panel.get_ylabel(), panel.get_title(), panel.get_title("left")])
        if hasattr(panel, "zaxis"):
            assert panel.get_zlabel().endswith("mm")
        assert UNIT.search(said), f"{name}: a panel without units: {said!r}"
    kept = tmp_path / "drawn.png"
    figure.savefig(kept, dpi=40)
    pixels = image.imread(kept)[..., :3]
    assert np.ptp(pixels) > 0.5
    text = [one.get_text() for one in figure.texts] + [one.get_title("left") + one.get_title() for one in figure.axes]
    assert any(text), "a picture says what it shows"


def test_figures_without_their_curves_are_not_drawn(tmp_path: Path) -> None:
    bare = dataclasses.replace(tf.evaluate(_bench(tmp_path)), found=None)
    with pytest.raises(tf.TrueflankError, match="E-LIBRARY-KIND"):
        bare.plot()


def test_the_drawn_curve_of_a_drive_is_its_own() -> None:
    drive = _drive()
    figure = drive.plot()
    lines = [line.get_ydata() for panel in figure.axes for line in panel.lines]
    assert any(len(y) == len(drive.curve()) and np.allclose(y, drive.curve()) for y in lines)
    surface = tf.flank(MACHINE, GEAR).surface()
    assert surface.to_pandas().shape == (surface.points[..., 0].size, 6)
    assert np.shape(surface.to_dict()["points_mm"]) == surface.points.shape
