"""Sweeps: the same numbers here, in processes and on a cluster; outputs of the flank; closed forms of whole grids."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest
from distributed import LocalCluster

from gateway.errors import ModelError
from gateway.gear.flank import flank_figure, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import TWENTY_ONE, yk7350b
from gateway.model.motion import Fourier, Polynomial
from gateway.sensitivity.outputs import (
    EQUAL_MM,
    OUTPUTS,
    FlankOutputs,
    Span,
    equal_size,
    equal_spans,
    figures,
    measured_spans,
)
from gateway.sensitivity.screening import exhaustive, run_sweep, screen, trajectories
from gateway.study.workers import workers
from tests.unit.gear.machines import RV40E, TEN_MILLIDEGREES

GRID = flank_grid(RV40E, profile=4, width=3)
GRINDING = Grinding(yk7350b(), RV40E, 160.0)
MODEL = FlankOutputs(GRINDING, GRID, equal_spans(TWENTY_ONE))


@pytest.mark.parametrize("levels", [2, 4, 6])
def test_quadratic_closed_form_over_the_whole_grid(levels: int) -> None:
    rng = np.random.default_rng(levels)
    M = rng.normal(size=(3, 3))
    M = 0.5 * (M + M.T)
    found = exhaustive(lambda x: np.einsum("ni,ij,nj->n", x, M, x), levels, 3)
    p = float(levels)
    off = M - np.diag(np.diag(M))
    mu = np.diag(M) + off.sum(axis=1)
    own = 4.0 * np.diag(M) ** 2 * ((p / 2) ** 2 - 1) / (12.0 * (p - 1) ** 2)
    sigma = np.sqrt(own + 4.0 * np.sum(off**2, axis=1) * (p**2 - 1) / (12.0 * (p - 1) ** 2))
    np.testing.assert_allclose(found.mu, mu, rtol=1e-10)
    np.testing.assert_allclose(found.sigma, sigma, rtol=1e-10)
    with pytest.raises(ModelError, match="E-SENS-LEVELS"):
        exhaustive([1.0], 3)


def test_null_errors_rank_last_with_nothing() -> None:
    found = screen(MODEL, TWENTY_ONE, OUTPUTS, r=6)
    for output in OUTPUTS:
        by_name = {one.name: one for one in found.rankings[output]}
        for name in ("EZX", "EZZ", "EZC", "EAZ", "EBZ"):
            assert by_name[name].mu_star < 1e-12
    best = {output: found.rankings[output][0].name for output in OUTPUTS}
    assert best["rms"] in ("EXX", "EXZ", "EXC", "EYC")
    assert best["runout"] in ("EXC", "EYC")
    assert best["lead"] in ("EAX", "A0C", "EAC", "EBC", "B0C", "EBX", "B0Z")


def test_orders_agree_and_exact_is_the_truth() -> None:
    x = trajectories(21, 1, seed=4)[0][:3]
    first, second, truth = (
        FlankOutputs(GRINDING, GRID, equal_spans(TWENTY_ONE), order)(x)
        for order in ("first", "second", "exact")  # type: ignore[arg-type]
    )
    assert np.max(np.abs(second - truth)) < 4e-6
    assert np.max(np.abs(first - truth)) < 1.2e-3
    with pytest.raises(ModelError, match="E-SENS-ORDER"):
        FlankOutputs(GRINDING, GRID, equal_spans(TWENTY_ONE), "third")  # type: ignore[arg-type]


def test_shapes_scale_the_error() -> None:
    wave = Polynomial((0.0, 1.0), 0.0, 5.0)
    for order in ("first", "second"):
        model = FlankOutputs(GRINDING, GRID, (Span("EXZ", 0.0, 0.004, wave), Span("EXX", 0.0, 0.002, 0.5)), order)
        out = model(np.array([[1.0, 0.0], [0.5, 0.0], [0.0, 1.0]]))
        assert out[0, 0] == pytest.approx(2.0 * out[1, 0], rel=1e-3)
        flat = flank_figure(0.001 * -GRID.section.nx + np.zeros(GRID.shape), GRID.section.h)
        assert out[2, 0] == pytest.approx(flat.rms, rel=1e-2)


def test_figures_take_the_common_rotation_as_the_datum() -> None:
    turned = np.broadcast_to(1e-5 * GRID.section.h, GRID.shape)
    assert np.max(figures(GRID, turned)) < 1e-12


def test_spans() -> None:
    assert equal_size("EXX") == EQUAL_MM
    for name in ("EAX", "ECC", "B0Z", "A0C"):
        assert equal_size(name) == pytest.approx(TEN_MILLIDEGREES)
    both = equal_spans(("EXX",), symmetric=True)[0]
    assert (both.low, both.high) == (-EQUAL_MM, EQUAL_MM)
    chain = yk7350b(
        {"EXZ": Polynomial((0.0, 0.002), 0.0, 10.0), "ECC": Fourier(0.0, (1e-5,)), "B0Z": -2e-5, "EXX": 0.003}
    )
    spans = measured_spans(Grinding(chain, RV40E, 160.0), ("EXZ", "ECC", "B0Z", "EXX", "EYX"), {"Z": (-10.0, 10.0)})
    wanted = [(-0.002, 0.002), (-1e-5, 1e-5), (-2e-5, 0.0), (0.0, 0.003), (0.0, 0.0)]
    np.testing.assert_allclose([(one.low, one.high) for one in spans], wanted, atol=1e-9)


def test_the_order_of_the_points_is_kept_by_any_executor() -> None:
    points = trajectories(21, 5, seed=9)
    here = run_sweep(MODEL, points)
    assert here.shape == (5, 22, 6)
    with ThreadPoolExecutor(3) as pool:
        for parts in (None, 1, 2, 99):
            np.testing.assert_array_equal(run_sweep(MODEL, points, pool, parts), here)
    with pytest.raises(ModelError, match="E-SENS-SHAPE"):
        run_sweep(MODEL, np.zeros(3))


def test_a_model_is_plain_data() -> None:
    copy = pickle.loads(pickle.dumps(MODEL))  # noqa: S301
    x = np.full((1, 21), 0.5)
    np.testing.assert_array_equal(copy(x), MODEL(x))


class _Lost(Executor):
    """An executor whose worker dies."""

    def submit(self, fn: object, /, *args: object, **kwargs: object) -> Future:  # type: ignore[override]
        """A future that fails."""
        future: Future = Future()
        future.set_exception(BrokenExecutor("the worker was killed"))
        return future


def test_a_lost_worker_is_said() -> None:
    with pytest.raises(ModelError, match="killed"):
        run_sweep(MODEL, trajectories(21, 2), _Lost())


def test_processes_give_the_same_numbers() -> None:
    points = trajectories(21, 4, seed=3)
    with workers(count=2) as pool:
        assert pool is not None
        np.testing.assert_array_equal(run_sweep(MODEL, points, pool), run_sweep(MODEL, points))
    with workers(count=1) as none:
        assert none is None
    with pytest.raises(ModelError, match="E-STUDY-WORKERS"), workers(count=0):
        pass


@pytest.fixture
def scheduler() -> Iterator[str]:
    """A real cluster of two worker processes on loopback."""
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None, silence_logs=40
    ) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_gives_the_same_numbers(scheduler: str) -> None:
    points = trajectories(21, 4, seed=3)
    with workers(scheduler) as cluster:
        assert cluster is not None
        np.testing.assert_array_equal(run_sweep(MODEL, points, cluster), run_sweep(MODEL, points))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x"])
def test_no_cluster_is_said(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.study.workers.CONNECT_S", 1)
    with pytest.raises(ModelError, match="E-SENS-SCHEDULER"), workers(address):
        pass
