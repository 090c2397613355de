"""Error motions from plain data and from fitted components."""

from __future__ import annotations

import numpy as np

from gateway.domain.figures import Component
from gateway.model.motion import motion_from, motion_of


def at(data: object, q: object) -> np.ndarray:
    motion = motion_of(data)
    assert callable(motion)
    return motion(np.asarray(q, dtype=np.float64))


def test_plain_data_mean_what_they_say() -> None:
    q = np.array([[-3.0, 0.0], [1.0, 7.5]])
    np.testing.assert_allclose(
        at({"type": "poly", "c": [1.0, 2.0, 3.0], "q0": 1.0, "scale": 2.0}, q), 1.0 + (q - 1.0) + 0.75 * (q - 1.0) ** 2
    )
    wanted = 0.5 + np.cos(q) + 2.0 * np.cos(2 * q) - np.sin(q)
    np.testing.assert_allclose(at({"type": "fourier", "a0": 0.5, "a": [1.0, 2.0], "b": [-1.0]}, q), wanted, atol=1e-14)
    np.testing.assert_allclose(at({"type": "fourier", "b": [1.0], "period": 8.0}, q), np.sin(np.pi / 4 * q), atol=1e-15)
    np.testing.assert_allclose(at({"type": "pl", "q": [0.0, 5.0], "v": [1.0, 2.0]}, [0.0, 1.0, 5.0]), [1.0, 1.2, 2.0])
    turning = {"type": "pl", "q": [0.0, 1.0], "v": [0.0, 1.0], "period": 2.0}
    np.testing.assert_allclose(at(turning, [0.5, 2.5, -1.5, 1.5]), 0.5)
    assert motion_of(3) == 3.0


def test_components_are_turned_into_mm_and_rad() -> None:
    def component(name: str, unit: str) -> Component:
        slope = {"degree": 1, "centre": 0.0, "scale": 1.0}
        zero = np.zeros((2, 2))
        return Component(name, name[2], unit, "polynomial", (-400.0, 400.0), np.array([0.0, 2.0]), zero, slope)  # type: ignore[arg-type]

    straightness, yaw, rotary = (motion_from(component(*one)) for one in (("EXZ", "mm"), ("EBZ", "mm"), ("ECC", "deg")))
    assert callable(straightness)
    assert callable(yaw)
    assert callable(rotary)
    q = np.array([10.0])
    np.testing.assert_allclose(straightness(q), 0.02)
    np.testing.assert_allclose(yaw(q), np.deg2rad(20.0 / 3600.0))
    np.testing.assert_allclose(rotary(np.deg2rad(q)), np.deg2rad(20.0 / 3600.0))
