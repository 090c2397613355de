"""A sweep of model runs over an executor: processes of this machine, a cluster, or none (then one after the other)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.sensitivity.morris import elementary_effects, trajectories
from gateway.sensitivity.ranks import Ranked, ranking

Model = Callable[[FloatArray], FloatArray]
"""Outputs (n, k) of points (n, d); must be plain data with a call, so that it can be sent to another process."""


@dataclass(frozen=True)
class Screening:
    """Elementary effects (r, d, k) of every input on every output, and the ranking of each output by name."""

    names: tuple[str, ...]
    outputs: tuple[str, ...]
    effects: FloatArray
    rankings: dict[str, tuple[Ranked, ...]]


def sweep(model: Model, points: ArrayLike, executor: Executor | None = None, parts: int | None = None) -> FloatArray:
    """Outputs (..., k) of points (..., d), cut along the first axis into ``parts`` pieces sent to the executor.

    Without an executor everything runs here, in one piece. The order of the results is that of the points.
    Raises ModelError E-SENS-WORKERS if a worker is lost.
    """
    x = np.asarray(points, dtype=np.float64)
    if x.ndim < 2 or not x.size:
        raise ModelError("E-SENS-SHAPE", "sweep", points=x.shape, outputs="none yet")
    if executor is None:
        return _piece(model, x)
    pieces = np.array_split(x, min(parts or x.shape[0], x.shape[0]))
    futures = [executor.submit(_piece, model, piece) for piece in pieces]
    try:
        return np.concatenate([future.result() for future in futures])
    except (BrokenExecutor, OSError) as error:
        raise ModelError("E-SENS-WORKERS", "sweep", why=f"{type(error).__name__} {error}") from error
    finally:
        for future in futures:
            future.cancel()


def screen(
    model: Model,
    names: tuple[str, ...],
    outputs: tuple[str, ...],
    *,
    r: int = 20,
    levels: int = 4,
    seed: int = 1,
    executor: Executor | None = None,
    parts: int | None = None,
) -> Screening:
    """Morris screening of a model with len(names) inputs in the unit cube and len(outputs) outputs."""
    points = trajectories(len(names), r, levels, seed)
    effects = elementary_effects(points, sweep(model, points, executor, parts))
    found = {name: ranking(names, effects[..., i], seed=seed) for i, name in enumerate(outputs)}
    return Screening(names, outputs, effects, found)


def _piece(model: Model, points: FloatArray) -> FloatArray:
    flat = points.reshape(-1, points.shape[-1])
    return np.asarray(model(flat)).reshape(*points.shape[:-1], -1)
