"""Rigid motions and twists."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from gateway.model import transforms


def generator(xi: np.ndarray) -> np.ndarray:
    out = np.zeros((4, 4))
    out[:3, :3] = transforms.hat(xi[3:])
    out[:3, 3] = xi[:3]
    return out


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-6, 1e-4, 0.05, 0.0999, 0.1001, 1.0, 3.0, 3.1415])
def test_log_undoes_exp_at_every_angle(angle: float) -> None:
    rng = np.random.default_rng(3)
    axis = rng.normal(size=3)
    xi = np.concatenate([rng.normal(size=3) * 100.0, axis / np.linalg.norm(axis) * angle])
    T = transforms.exp(xi)
    np.testing.assert_allclose(T, expm(generator(xi)), atol=2e-13)
    np.testing.assert_allclose(transforms.log(T), xi, rtol=1e-11, atol=1e-14 if angle < 1e-3 else 1e-11)


def test_small_rotation_keeps_its_digits() -> None:
    xi = np.array([1e-9, 0.0, 0.0, 1e-9, -2e-9, 3e-9])
    np.testing.assert_allclose(transforms.log(transforms.exp(xi)), xi, rtol=1e-7, atol=1e-25)


def test_half_turn_has_a_logarithm() -> None:
    for axis in np.eye(3):
        R = transforms.about(axis, np.pi)
        assert np.linalg.norm(transforms.rotation_vector(R)) == pytest.approx(np.pi, abs=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-2.0, 2.0), min_size=12, max_size=12))
def test_adjoint_carries_twists(numbers: list[float]) -> None:
    T, xi = transforms.exp(numbers[:6]), np.asarray(numbers[6:]) * 0.1
    moved = T @ transforms.exp(xi) @ transforms.inverse(T)
    np.testing.assert_allclose(transforms.exp(transforms.adjoint(T) @ xi), moved, atol=1e-12)


def test_batches_have_the_shape_of_their_positions() -> None:
    xi = np.random.default_rng(0).normal(size=(3, 4, 6)) * 0.3
    T = transforms.exp(xi)
    assert T.shape == (3, 4, 4, 4)
    np.testing.assert_allclose(transforms.log(T), xi, atol=1e-13)
    np.testing.assert_allclose(T @ transforms.inverse(T), np.broadcast_to(np.eye(4), T.shape), atol=1e-14)


def test_angles_are_applied_in_the_stated_order() -> None:
    x, y, z = np.eye(3)
    wanted = transforms.about(z, 0.3) @ transforms.about(y, 0.2) @ transforms.about(x, 0.1)
    np.testing.assert_allclose(transforms.rpy(0.1, 0.2, 0.3), wanted, atol=1e-15)
