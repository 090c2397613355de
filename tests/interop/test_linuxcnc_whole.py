"""A whole job on LinuxCNC's own kernel by the commands alone, judged by where the mill's slides truly stand."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.interop.linuxcnc_cell import Person, command, instruments, site_of
from tests.interop.linuxcnc_host import Host, running

pytestmark = [pytest.mark.interop, pytest.mark.wall_time, pytest.mark.timeout(1800)]

QUICK = {
    r"feed = 3000\.0": "feed = 4800.0",
    r"feed = 720\.0": "feed = 9000.0",
    r"feed_mm = 500\.0": "feed_mm = 4800.0",
    r"feed_deg = 360\.0": "feed_deg = 6000.0",
    # On a computer that has much else to do a fit may hold the stream up for longer than an instrument would.
    r"(?m)^settings = \{ (?=max_)": "settings = { stale_s = 60.0, ",
    r"(?m)^store = .*$": 'store = "runs"\napprovals = 1',
    r'(?m)^token_file = "token.txt"': 'token_file = "token.txt"\npoll_s = 0.02',
}
TARGETS = r'first = 0\.0, last = {}\.0, count = "iso230-2"'
STOPS = "stable = 1.0\nbetween = 0\nstandstill = 0\ndwell_s = 0.05\n"
SHORT = QUICK | {
    TARGETS.format(300): "first = 0.0, last = 30.0, count = 7",
    TARGETS.format(360): "first = 0.0, last = 30.0, count = 7",
    r"maximum = 300\.0": "maximum = 30.0",
    r"travel = \[-5\.0, 305\.0\]": "travel = [-5.0, 45.0]",
    r"travel = \[-20\.0, 380\.0\]": "travel = [-20.0, 60.0]",
    r"maximum = 360\.0(.*\n)step = 5\.0": r"maximum = 30.0\1step = 5.0",
    r"repetitions = 5 ": "repetitions = 3 ",
    r"(?m)^stable = .*$": f"{STOPS}settle_s = 0.05\naverage_s = 0.05\nextra_hours = 0.0",
}
LONG = QUICK | {
    TARGETS.format(300): "first = 0.0, last = 80.0, count = 9",
    TARGETS.format(360): "first = 0.0, last = 360.0, count = 17",
    r"maximum = 300\.0": "maximum = 80.0",
    r"repetitions = 5 ": "repetitions = 3 ",
    r"(?m)^stable = .*$": f"{STOPS}settle_s = 0.25\naverage_s = 0.1",
}
UM, ARCSEC = 1e3, 3600.0
# At a point of X's table nothing is left, between two what a straight line misses of a wave of 2 um each 40 mm: h^2 / 8
# times its curvature.
NODES_UM, BETWEEN_UM = 0.01, 5.0**2 / 8.0 * (2.0 * np.pi / 40.0) ** 2 * 2.0
Places = dict[str, np.ndarray]
Ways = dict[str, tuple[np.ndarray, np.ndarray]]


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="tf-mill-") as made:
        base = Path(made)
        base.chmod(0o755)
        (base / "mill").mkdir()
        yield base / "mill"


async def truth(host: Host, places: Places) -> Ways:
    """Deviations of X (um) and A (arcsec) at these places (n,) come to from below and from above, by axis."""
    x, a = places["X"], places["A"]
    blocks = [f"G0 X{one:.6f} A{other:.6f}" for one, other in zip(x, a, strict=True)]
    turn = f"G0 X{x[-1] + 15} A{a[-1] + 15}"
    seen = await host.person("walk", ["G0 X-10 A-10", *blocks, turn, *reversed(blocks)])
    found = [one["true"] for one in seen]
    ways = found[1 : x.size + 1], found[: x.size + 1 : -1]
    up, down = np.asarray(ways[0]), np.asarray(ways[1])
    return {
        "X": ((up[:, 0] - x) * UM, (down[:, 0] - x) * UM),
        "A": ((up[:, 3] - a) * ARCSEC, (down[:, 3] - a) * ARCSEC),
    }


def sizes(ways: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Range of the mean of both directions, and the largest reversal."""
    return float(np.ptp((ways[0] + ways[1]) / 2.0)), float(np.abs(ways[0] - ways[1]).max())


def judged(before: Ways, after: Ways, said: str) -> None:
    """Range and reversal are smaller by 95 %, or 0.5 um or arcsec at most."""
    for axis, ways in after.items():
        was = sizes(before[axis])
        for is_now, one in zip(sizes(ways), was, strict=True):
            assert is_now <= max(0.05 * one, 0.5), (axis, sizes(ways), was, said)


async def site_at(host: Host, urls: tuple[str, str], changes: dict[str, str]) -> str:
    """The example's site file for this mill."""
    async with host.device() as device:
        serial = (await device.identify()).serial
    return str(site_of(host, serial, urls, changes))


async def test_a_linear_and_a_rotary_axis_get_true_between_two_measurements(folder: Path) -> None:
    """Measured, pushed, restarted, measured again; every other place is a point of the table, the rest lie between."""
    places = {"X": np.linspace(0.0, 30.0, 13), "A": np.linspace(0.0, 30.0, 13)}
    async with running(folder) as host, instruments(host) as urls:
        site, person = await site_at(host, urls, SHORT), Person(host)
        before = await truth(host, places)
        code, said = await command("run", site, "--apply", "--machine", "hobby-mill", heard=person.hears)
        assert code == 0, said
        assert person.restarts == 5  # twice for each sign, once for both tables
        code, said = await command("tables", "verify", site)
        assert code == 0, said
        after = await truth(host, places)
        judged(before, after, said)
        for way in after["X"]:
            assert np.abs(way[::2]).max() < NODES_UM, way
            assert np.abs(way[1::2]).max() < NODES_UM + BETWEEN_UM, way


# Far longer than the rest of `make interop`: the kernel keeps its own time. `make kernel` runs it.
@pytest.mark.soak
async def test_both_axes_get_better_and_the_way_back_leads_back(folder: Path) -> None:
    """Places between the points of both tables (every 5 mm, 5 deg), and at some of them."""
    places = {"X": np.linspace(2.5, 77.5, 16), "A": np.linspace(7.5, 352.5, 16)}
    async with running(folder) as host, instruments(host) as urls:
        site, person = await site_at(host, urls, LONG), Person(host)
        before = await truth(host, places)
        code, said = await command("doctor", site)
        assert code == 0, said
        assert f"next: trueflank run {site}" in said
        code, said = await command("run", site, "--apply", "--machine", "hobby-mill", heard=person.hears)
        assert code == 0, said
        judged(before, await truth(host, places), said)
        code, said = await command("tables", "verify", site)
        assert code == 0, said
        back = ("rollback", site, "--axis", "X", "--apply", "--machine", "hobby-mill")
        code, said = await command(*back, heard=person.hears)
        assert code == 0, said
        off = ("disable", site, "--axis", "A", "--apply", "--machine", "hobby-mill")
        code, said = await command(*off, heard=person.hears)
        assert code == 0, said
        for axis, ways in (await truth(host, places)).items():
            assert sizes(ways) == pytest.approx(sizes(before[axis]), abs=0.02), axis
