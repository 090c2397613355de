"""The chain: poses, twists, names and what it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from drivers.errors import catalogue
from gateway.errors import ModelError
from gateway.model import transforms
from gateway.model.chain import LOCATIONS, MOTIONS, Axis, Chain, FixedLink
from gateway.model.error_model import TWENTY_ONE, yk7350b
from gateway.model.frames import chain_of


def random_chain(seed: int, scale: float = 1.0) -> tuple[Chain, dict[str, float]]:
    """Five axes of both kinds with links, all 12 errors each, mixed frames."""
    rng = np.random.default_rng(seed)

    def axis(name: str, kind: Any) -> Axis:
        size = [0.01] * 3 + [1e-4] * 3
        err = {key: float(rng.normal() * size[i] * scale) for i, key in enumerate(MOTIONS)}
        loc = {key: float(rng.normal() * size[i] * scale) for i, key in enumerate(LOCATIONS)}
        frame: Any = rng.choice(["moving", "fixed"])
        return Axis(name, kind, tuple(rng.normal(size=3)), err, loc, str(frame))  # type: ignore[arg-type]

    def link() -> FixedLink:
        return FixedLink(tuple(rng.normal(size=3) * 100.0), tuple(rng.normal(size=3)))

    work = (axis("X", "prismatic"), link(), axis("C", "revolute"), axis("A", "revolute"), link())
    tool = (link(), axis("Z", "prismatic"), axis("Y", "prismatic"), link())
    return Chain(work, tool), {"X": 40.0, "C": 0.7, "A": -0.4, "Z": -60.0, "Y": 12.0}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("frame", ["work", "wheel"])
def test_first_order_is_the_limit_of_the_exact_twist(seed: int, frame: Any) -> None:
    tiny = 1e-5
    whole, q = random_chain(seed)
    small, _ = random_chain(seed, tiny)
    first = whole.twist(q, frame)
    np.testing.assert_allclose(small.exact_twist(q, frame) / tiny, first, rtol=1e-4, atol=1e-6)
    assert np.linalg.norm(whole.exact_twist(q, frame) - first) < 2e-3 * np.linalg.norm(first)


def test_wheel_frame_is_the_adjoint_of_the_work_frame() -> None:
    chain, q = random_chain(11)
    back = transforms.adjoint(transforms.inverse(chain.ideal(q)))
    np.testing.assert_allclose(chain.twist(q, "wheel"), back @ chain.twist(q, "work"), atol=1e-15)


def test_positions_broadcast_like_arrays() -> None:
    chain, q = random_chain(5)
    batch = {**q, "C": np.linspace(0.0, 6.0, 4)[:, None], "Z": np.linspace(-5.0, 5.0, 3)}
    assert chain.actual(batch).shape == (4, 3, 4, 4)
    assert chain.twist(batch).shape == (4, 3, 6)
    one = {**q, "C": 2.0, "Z": 0.0}
    np.testing.assert_allclose(chain.twist(batch)[1, 1], chain.twist(one), atol=1e-16)
    np.testing.assert_allclose(chain.actual(batch)[1, 1], chain.actual(one), atol=1e-12)
    np.testing.assert_allclose(chain.exact_twist(batch)[1, 1], chain.exact_twist(one), atol=1e-12)


def test_a_command_moves_like_the_exact_chain() -> None:
    chain, q = random_chain(8)
    perfect = chain.without_errors()
    for influence in perfect.influences(q):
        moved = {**q, influence.axis.name: q[influence.axis.name] + 1e-6}
        exact = transforms.log(perfect.ideal(moved) @ transforms.inverse(perfect.ideal(q))) / 1e-6
        np.testing.assert_allclose(influence.command(), exact, rtol=1e-5, atol=2e-6)


@pytest.mark.parametrize("frame", ["moving", "fixed"])
def test_preset_has_the_closed_form_of_its_first_order(frame: Any) -> None:
    rng = np.random.default_rng(2)
    e = {name: float(rng.normal()) * 1e-4 for name in TWENTY_ONE}
    x, z, c = -160.0, 7.0, 0.6
    xi = yk7350b(e, c_frame=frame).twist({"X": x, "Z": z, "C": c})
    d = np.array(
        [
            e["EXZ"] - e["EXX"] - z * e["EBZ"] + z * e["B0Z"],
            e["EYZ"] - e["EYX"] + z * e["EAZ"] + x * e["ECZ"],
            e["EZZ"] - e["EZX"] - x * e["EBZ"],
        ]
    )
    w = np.array([e["EAZ"] - e["EAX"] - e["A0C"], e["EBZ"] - e["EBX"] - e["B0C"], e["ECZ"] - e["ECX"]])
    dc, wc = np.array([e["EXC"], e["EYC"], e["EZC"]]), np.array([e["EAC"], e["EBC"], e["ECC"]])
    back = transforms.about([0.0, 0.0, 1.0], -c)
    if frame == "fixed":
        wanted = np.concatenate([back @ (d - dc), back @ (w - wc)])
    else:
        wanted = np.concatenate([back @ d - dc, back @ w - wc])
    np.testing.assert_allclose(xi, wanted, atol=1e-15)


def test_errors_are_set_by_their_iso_names() -> None:
    chain = yk7350b({"EXZ": 0.005, "B0C": 1e-5})
    assert chain.axis("Z").err == {"dx": 0.005}
    assert chain.axis("C").loc == {"B0": 1e-5}
    assert set(TWENTY_ONE) < set(chain.error_names())
    assert chain.without_errors() == yk7350b()
    with pytest.raises(ModelError) as caught:
        chain.with_errors({"EXQ": 1.0})
    assert caught.value.code == "E-CHAIN-ERROR-NAME"
    with pytest.raises(ModelError) as caught:
        chain.with_errors({"B0Z": lambda q: q})
    assert caught.value.code == "E-CHAIN-NUMBER"


def test_functions_are_taken_at_the_axis_own_position() -> None:
    chain = yk7350b({"EXZ": lambda z: 1e-3 * z})
    z = np.array([0.0, 2.0, 5.0])
    np.testing.assert_allclose(chain.twist({"X": -100.0, "Z": z, "C": 0.0})[:, 0], 1e-3 * z, atol=1e-18)


X = {"kind": "prismatic", "name": "X", "axis": [1, 0, 0]}
BAD: list[tuple[str, dict[str, Any]]] = [
    ("E-CHAIN-EMPTY", {"work": [], "tool": []}),
    ("E-CHAIN-TWICE", {"work": [X], "tool": [X]}),
    ("E-CHAIN-DIRECTION", {"work": [{**X, "axis": [0, 0, 0]}]}),
    ("E-CHAIN-NUMBER", {"work": [{**X, "axis": [1, 0]}]}),
    ("E-CHAIN-NUMBER", {"work": [{**X, "axis": [1, 0, float("nan")]}]}),
    ("E-CHAIN-NUMBER", {"work": [{**X, "axis": "up"}]}),
    ("E-CHAIN-NUMBER", {"work": [{**X, "loc": {"X0": "far"}}]}),
    ("E-CHAIN-NUMBER", {"work": [{**X, "loc": {"X0": float("inf")}}]}),
    ("E-CHAIN-NUMBER", {"work": [X, {"kind": "fixed", "xyz": [1, 2]}]}),
    ("E-CHAIN-WORD", {"work": [{**X, "kind": "spherical"}]}),
    ("E-CHAIN-WORD", {"work": [{**X, "err_frame": "bed"}]}),
    ("E-CHAIN-WORD", {"work": [{**X, "err": {"dq": 1.0}}]}),
    ("E-CHAIN-WORD", {"work": [{**X, "loc": {"Q0": 1.0}}]}),
    ("E-CHAIN-WORD", {"work": [{**X, "color": "red"}]}),
    ("E-CHAIN-WORD", {"table": [X]}),
    ("E-CHAIN-NAME", {"work": [{**X, "name": ""}]}),
    ("E-CHAIN-TILT", {"work": [{**X, "loc": {"B0": 5.7}}]}),
    ("E-CHAIN-ELEMENT", {"work": X}),
    ("E-CHAIN-ELEMENT", {"work": ["X"]}),
    ("E-CHAIN-ELEMENT", {"work": [{"kind": "prismatic", "name": "X"}]}),
    ("E-CHAIN-MOTION-DATA", {"work": [{**X, "err": {"dx": {"type": "magic"}}}]}),
    ("E-CHAIN-MOTION-DATA", {"work": [{**X, "err": {"dx": {"type": "poly", "c": []}}}]}),
    ("E-CHAIN-MOTION-DATA", {"work": [{**X, "err": {"dx": {"type": "pl", "q": [1, 0], "v": [0, 0]}}}]}),
    ("E-CHAIN-MOTION-DATA", {"work": [{**X, "err": {"dx": "five"}}]}),
]


@pytest.mark.parametrize(("code", "data"), BAD)
def test_malformed_chains_are_refused_in_words(code: str, data: dict[str, Any]) -> None:
    with pytest.raises(ModelError) as caught:
        chain_of(data)
    assert caught.value.code == code
    assert code in catalogue()
    assert "<" not in caught.value.what


@pytest.mark.parametrize("q", [{}, {"X": 1.0, "Z": 2.0}, {"X": 1.0, "Z": float("nan"), "C": 0.0}])
def test_a_missing_position_is_refused(q: dict[str, float]) -> None:
    with pytest.raises(ModelError) as caught:
        yk7350b().ideal(q)
    assert caught.value.code == "E-CHAIN-POSITION"


def test_a_motion_of_the_wrong_shape_is_refused() -> None:
    with pytest.raises(ModelError) as caught:
        yk7350b({"EXX": lambda q: np.zeros(7)}).actual({"X": 1.0, "Z": 0.0, "C": 0.0})
    assert caught.value.code == "E-CHAIN-MOTION"
