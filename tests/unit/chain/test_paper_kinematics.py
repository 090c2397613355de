"""The paper's kinematics written out by symbols from its own words, against the matrices and six errors of the library.

Section 3 names every matrix: the shift of X and Z, the turn of C, the error matrix of an axis with its three small
angles and three shifts, the displacement vector of X with its perpendicularity errors, the identities of work and
wheel. They are built here by sympy alone, multiplied, inverted and cut after the first order; nothing of ours is used.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import trueflank as tf

ARCSEC = 180.0 * 3600.0 / np.pi
ANGLES = ("A", "B", "C")
x, z, tiny = sp.symbols("x z tiny", real=True)
co, si = sp.symbols("cos_c sin_c", real=True)
"""Cosine and sine of the turn as two symbols with co^2 + si^2 = 1: polynomials are multiplied out in a moment."""
NAMES = [f"E{letter}{axis}" for axis in "XZC" for letter in "XYZABC"]
LOCATIONS = ["B0X", "C0X", "A0Z", "B0Z", "X0C", "Y0C", "Z0C", "A0C", "B0C", "C0C"]
E = {name: sp.Symbol(name, real=True) for name in (*NAMES, *LOCATIONS)}


def _plain(one: sp.Matrix) -> sp.Matrix:
    """Multiplied out, sin^2 as 1 - cos^2."""
    return one.applyfunc(lambda entry: sp.rem(sp.expand(entry), si**2 + co**2 - 1, si))


def _inverse(rigid: sp.Matrix) -> sp.Matrix:
    """Of a rotation with a shift."""
    turned = rigid[:3, :3].T
    return sp.Matrix.vstack(sp.Matrix.hstack(turned, -turned * rigid[:3, 3]), rigid[3, :])


def _shift(*by: sp.Expr) -> sp.Matrix:
    return sp.Matrix([[1, 0, 0, by[0]], [0, 1, 0, by[1]], [0, 0, 1, by[2]], [0, 0, 0, 1]])


def _small(a: sp.Expr, b: sp.Expr, g: sp.Expr, *shift: sp.Expr) -> sp.Matrix:
    """The paper's error matrix: small angles about x, y, z, and a displacement vector."""
    return sp.Matrix([[1, -g, b, shift[0]], [g, 1, -a, shift[1]], [-b, a, 1, shift[2]], [0, 0, 0, 1]])


def _of(axis: str, *path: sp.Expr) -> sp.Matrix:
    """Angles of an axis with its displacement vector: what it moves by and its three shifts."""
    d = [E[f"E{letter}{axis}"] + along for letter, along in zip("XYZ", path, strict=True)]
    return _small(*(E[f"E{letter}{axis}"] for letter in ANGLES), *d)


TURN = sp.Matrix([[co, -si, 0, 0], [si, co, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
X_SLIDE = _of("X", x, x * E["C0X"], -x * E["B0X"])
Z_SLIDE = _of("Z", z * E["B0Z"], -z * E["A0Z"], z)
C_STATOR = _small(*(E[f"{one}0C"] for one in ANGLES), *(E[f"{one}0C"] for one in "XYZ"))
IDEAL = _inverse(_shift(x, 0, 0) * TURN) * _shift(0, 0, z)


@cache
def relative_by_symbols(frame: str, told_in: str) -> sp.Matrix:
    """dx, dy, dz, ea, eb, ec to first order: the derivative by one factor of all errors, at none."""
    own = _of("C", 0, 0, 0)
    sized = {one: tiny * one for one in E.values()}
    parts = [X_SLIDE, C_STATOR, *((TURN, own) if frame == "moving" else (own, TURN))]
    work = [one.subs(sized) for one in parts]
    flat = [one.subs(tiny, 0) for one in work]
    changes = [sp.prod([*flat[:i], one.diff(tiny), *flat[i + 1 :]]) for i, one in enumerate(work)]
    there = Z_SLIDE.subs(sized)
    back = _inverse(_plain(sp.prod(flat)))
    # d inv(W) = -inv(W) dW inv(W): the inverse of the paper's matrix, cut after the first order.
    turned = _plain(back * sum(changes, sp.zeros(4, 4)) * back)
    change = _plain(back * there.diff(tiny) - turned * there.subs(tiny, 0))
    error = _plain(change * _inverse(IDEAL) if told_in == "work" else _inverse(IDEAL) * change)
    assert _plain(error[:3, :3] + error[:3, :3].T) == sp.zeros(3, 3), "the angles of the product are a rotation"
    return sp.Matrix([error[0, 3], error[1, 3], error[2, 3], error[2, 1], error[0, 2], error[1, 0]])


def test_the_ideal_matrix_is_the_papers_product() -> None:
    machine = tf.Machine()
    at = {"X": -160.0, "Z": 4.0, "C": 33.0}
    printed = np.asarray(sp.lambdify((x, z, co, si), IDEAL)(-160.0, 4.0, *_turned(33.0)))
    np.testing.assert_allclose(machine.matrix(state="ideal", **at), printed, atol=1e-12)
    np.testing.assert_allclose(machine.matrix("work", "wheel", state="ideal", **at) @ printed, np.eye(4), atol=1e-12)
    links = [machine.matrix("X", "bed", X=-160.0), machine.matrix("C", "X", C=33.0), machine.matrix("work", "C")]
    tool = machine.matrix("Z", "bed", Z=4.0) @ machine.matrix("wheel", "Z")
    np.testing.assert_allclose(np.linalg.inv(links[0] @ links[1] @ links[2]) @ tool, printed, atol=1e-12)


def _turned(deg: float) -> tuple[float, float]:
    return float(np.cos(np.deg2rad(deg))), float(np.sin(np.deg2rad(deg)))


def _given(seed: int) -> tuple[dict[str, float], dict[sp.Symbol, float]]:
    """Random errors as the library takes them (um, arcsec), and as the symbols count them (mm, rad)."""
    rng = np.random.default_rng(seed)
    shown, counted = {}, {}
    for name, symbol in E.items():
        angle = (name[1] if name[0] == "E" else name[0]) in ANGLES
        shown[name] = float(rng.uniform(-1.0, 1.0) * (20.0 if angle else 5.0))
        counted[symbol] = shown[name] / ARCSEC if angle else shown[name] / 1000.0
    return shown, counted


@pytest.mark.parametrize("told_in", ["work", "wheel"])
@pytest.mark.parametrize("frame", ["moving", "fixed"])
def test_the_six_relative_errors_are_those_of_the_papers_matrices(frame: str, told_in: str) -> None:
    symbols = relative_by_symbols(frame, told_in)
    shown, counted = _given(1)
    machine = tf.Machine(shown, machine={"c_frame": frame})
    places = np.array([[-160.0, 5.0, 0.0], [-120.0, -30.0, 77.0], [40.0, 12.0, 200.0]])
    by_hand = sp.lambdify([(x, z, co, si), list(E.values())], symbols)
    at = {name: places[:, i] for i, name in enumerate("XZC")}
    wanted = np.array(
        [by_hand((px, pz, *_turned(pc)), [counted[one] for one in E.values()]).ravel() for px, pz, pc in places]
    )
    units = np.array([1000.0] * 3 + [ARCSEC] * 3)
    first = machine.relative(frame=told_in, order="first", **at)
    found = np.stack([first[name] for name in ("dx", "dy", "dz", "ea", "eb", "ec")], axis=-1)
    np.testing.assert_allclose(found, wanted * units, atol=1e-9)
    for order in ("exact", "small-angle"):  # both differ by second order alone: 20 arcsec x 20 arcsec x 160 mm
        other = machine.relative(frame=told_in, order=order, **at)
        np.testing.assert_allclose(np.stack([other[n] for n in ("dx", "dy", "dz")], -1), found[:, :3], atol=0.02)
        np.testing.assert_allclose(np.stack([other[n] for n in ("ea", "eb", "ec")], -1), found[:, 3:], atol=0.02)


def test_the_small_angle_matrices_are_the_papers_entry_by_entry() -> None:
    shown, counted = _given(2)
    machine = tf.Machine(shown)
    at = dict(zip((x, z, co, si), (-160.0, 7.0, *_turned(50.0)), strict=True))
    for frame, into, printed, where in (
        ("X", "bed", X_SLIDE, {"X": -160.0}),
        ("Z", "bed", Z_SLIDE, {"Z": 7.0}),
        ("C", "X", C_STATOR * TURN * _of("C", 0, 0, 0), {"C": 50.0}),
    ):
        wanted = np.asarray(sp.lambdify([*counted, *at], printed)(*counted.values(), *at.values()), dtype=float)
        # The path of X and Z counts along the tilted direction; error and tilt are added, not multiplied, as printed.
        np.testing.assert_allclose(machine.matrix(frame, into, state="small-angle", **where), wanted, atol=1e-13)
        exact = machine.matrix(frame, into, **where)
        assert abs(np.linalg.det(exact[:3, :3]) - 1.0) < 1e-15, "exact matrices are rotations"
        np.testing.assert_allclose(exact, wanted, atol=2e-6)
    whole = np.linalg.inv(machine.matrix("work", "bed", state="small-angle", X=-160.0, C=50.0)) @ machine.matrix(
        "wheel", "bed", state="small-angle", Z=7.0
    )
    found = machine.matrix(state="small-angle", X=-160.0, C=50.0, Z=7.0)
    np.testing.assert_allclose(found, whole, atol=1e-12)
    back = machine.matrix("work", "wheel", state="small-angle", X=-160.0, C=50.0, Z=7.0)
    np.testing.assert_allclose(back @ found, np.eye(4), atol=1e-12)


def test_the_closed_form_of_the_handbook_is_what_the_symbols_give() -> None:
    """The page of the paper prints d' and e' in the slide's frame; turned into the work they are the six."""
    page = (Path(__file__).parents[3] / "docs" / "paper.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```text\n(d'x = .*?)```", page, re.DOTALL)
    rows = dict(re.findall(r"^([de]'[xyz]) = (.+)$", block, re.MULTILINE))
    known = {**{name: E[name] for name in E}, "x": x, "z": z}
    d, e = (sp.Matrix([sp.sympify(rows[f"{kind}'{one}"], locals=known) for one in "xyz"]) for kind in "de")
    own = [sp.Matrix([E[f"E{one}C"] for one in letters]) for letters in ("XYZ", ANGLES)]
    back = TURN[:3, :3].T
    wanted = sp.Matrix.vstack(back * d - own[0], back * e - own[1])
    assert _plain(relative_by_symbols("moving", "work") - wanted) == sp.zeros(6, 1)
