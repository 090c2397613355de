"""Three-vectors and rotations kept as separate arrays, so that each part stays as small as it can (mm, rad)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray

Vector = tuple[FloatArray, FloatArray, FloatArray]
Rotation = tuple[Vector, Vector, Vector]


def vector(array: ArrayLike) -> Vector:
    """Parts of an array (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(array, dtype=np.float64), -1, 0)
    return x, y, z


def rotation(matrix: FloatArray) -> Rotation:
    """Rows of rotations (..., 3, 3)."""
    first, second, third = (vector(matrix[..., row, :]) for row in range(3))
    return first, second, third


def rpy(a: FloatArray, b: FloatArray, c: FloatArray) -> Rotation:
    """Rows of Rz(c) Ry(b) Rx(a); shapes broadcast part by part."""
    sa, ca, sb, cb, sc, cc = np.sin(a), np.cos(a), np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    return (
        (cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa),
        (sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa),
        (-sb, cb * sa, cb * ca),
    )


def transpose(R: Rotation) -> Rotation:
    """The inverse rotation."""
    first, second, third = zip(*R, strict=True)
    return first, second, third


def dot(a: Vector, b: Vector) -> FloatArray:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def turn(R: Rotation, v: Vector) -> Vector:
    """R v."""
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


def add(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def sub(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(factor: FloatArray | float, v: Vector) -> Vector:
    """factor v."""
    return factor * v[0], factor * v[1], factor * v[2]


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
