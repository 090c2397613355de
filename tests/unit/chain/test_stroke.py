"""The split chain: same poses as the whole, exact velocity."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.model import transforms
from gateway.model.chain import Chain
from gateway.model.motion import Fourier, Polynomial
from gateway.model.stroke import split
from gateway.model.transforms import vector
from tests.unit.chain.test_chain import random_chain


def waved(chain: Chain) -> Chain:
    """The same machine with errors that vary with X, Y and Z."""
    return chain.with_errors(
        {
            f"E{letter}{axis}": Polynomial((1e-4, 2e-3, -1e-3), 0.0, 50.0)
            if letter in "XYZ"
            else Fourier(0.0, (2e-5,), (1e-5,), 40.0)
            for letter in "XYZABC"
            for axis in "XYZ"
        }
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["X", "Y", "Z"])
def test_points_and_velocity_are_those_of_the_whole_chain(seed: int, name: str) -> None:
    chain, q = random_chain(seed)
    chain = waved(chain)
    s = np.array([-3.0, 0.5, 8.0])
    point = np.random.default_rng(seed).normal(size=(3, 3)) * 50.0
    stroke = split(chain, name, {**q, name: 0.0})
    pose = stroke.pose(s)
    entered, way = stroke.enter(vector(point), vector(point))
    back = transforms.inverse(chain.actual({**q, name: s}))
    np.testing.assert_allclose(np.stack(pose.point(entered), -1), transforms.move(back, point), atol=1e-11)
    np.testing.assert_allclose(
        np.stack(np.broadcast_arrays(*pose.direction(way)), -1), transforms.apply(back[:, :3, :3], point), atol=1e-11
    )
    h = 1e-3
    step = transforms.log(back @ chain.actual({**q, name: s + h})) - transforms.log(
        back @ chain.actual({**q, name: s - h})
    )
    twist = np.stack(np.broadcast_arrays(*pose.twist.v, *pose.twist.w), -1)
    np.testing.assert_allclose(twist, step / (2.0 * h), atol=2e-9)


def test_only_a_linear_axis_carries_a_stroke() -> None:
    chain, q = random_chain(1)
    with pytest.raises(ModelError) as caught:
        split(chain, "C", q)
    assert caught.value.code == "E-CHAIN-STROKE"


def test_a_perfect_axis_moves_along_its_direction() -> None:
    chain = random_chain(2)[0].without_errors()
    _, q = random_chain(2)
    twist = split(chain, "Z", q).pose(np.asarray(1.0)).twist
    assert np.linalg.norm(np.stack(twist.v)) == pytest.approx(1.0, abs=1e-14)
    assert np.max(np.abs(np.stack(twist.w))) == 0.0
