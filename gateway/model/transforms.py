"""Rigid motions and twists, batched: 4x4 matrices (..., 4, 4) and twists (..., 6) = (delta mm, epsilon rad)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray

SERIES_BELOW = 0.1  # rad: under this the closed forms lose digits and the series has them all


def hat(w: ArrayLike) -> FloatArray:
    """Skew matrix (..., 3, 3) of a vector (..., 3): hat(w) v = w x v."""
    a = np.asarray(w, dtype=np.float64)
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = a[..., 2], -a[..., 1], a[..., 0]
    return out


def about(axis: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Rotation (..., 3, 3) by an angle (...) in rad about a unit axis (3,) (Rodrigues)."""
    q = np.asarray(angle, dtype=np.float64)[..., None, None]
    k = hat(axis)
    return np.eye(3) + np.sin(q) * k + 2.0 * np.sin(q / 2.0) ** 2 * (k @ k)


def rpy(a: ArrayLike, b: ArrayLike, c: ArrayLike) -> FloatArray:
    """Rz(c) Ry(b) Rx(a), shape (..., 3, 3), angles in rad of one broadcast shape."""
    a, b, c = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (a, b, c)))
    sa, ca, sb, cb, sc, cc = np.sin(a), np.cos(a), np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    out = np.empty((*a.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = -sb, cb * sa, cb * ca
    return out


def rigid(rotation: FloatArray, shift: FloatArray) -> FloatArray:
    """Homogeneous matrix of a rotation (..., 3, 3) and a shift (..., 3)."""
    shape = np.broadcast_shapes(rotation.shape[:-2], shift.shape[:-1])
    out = np.zeros((*shape, 4, 4))
    out[..., :3, :3] = rotation
    out[..., :3, 3] = shift
    out[..., 3, 3] = 1.0
    return out


def trans(shift: ArrayLike) -> FloatArray:
    """Pure translation by (..., 3)."""
    return rigid(np.eye(3), np.asarray(shift, dtype=np.float64))


def inverse(T: FloatArray) -> FloatArray:
    """Inverse of rigid motions (..., 4, 4)."""
    rotation = np.swapaxes(T[..., :3, :3], -1, -2)
    return rigid(rotation, -(rotation @ T[..., :3, 3:])[..., 0])


def adjoint(T: FloatArray) -> FloatArray:
    """Ad(T), shape (..., 6, 6): Ad(d, w) = (R d + p x R w, R w)."""
    rotation = T[..., :3, :3]
    out = np.zeros((*T.shape[:-2], 6, 6))
    out[..., :3, :3] = rotation
    out[..., 3:, 3:] = rotation
    out[..., :3, 3:] = hat(T[..., :3, 3]) @ rotation
    return out


def carry(T: FloatArray, xi: FloatArray) -> FloatArray:
    """Ad(T) xi of twists (..., 6), without making the matrix."""
    d, w = apply(T[..., :3, :3], xi[..., :3]), apply(T[..., :3, :3], xi[..., 3:])
    p = T[..., :3, 3]
    x = d[..., 0] + p[..., 1] * w[..., 2] - p[..., 2] * w[..., 1]
    y = d[..., 1] + p[..., 2] * w[..., 0] - p[..., 0] * w[..., 2]
    z = d[..., 2] + p[..., 0] * w[..., 1] - p[..., 1] * w[..., 0]
    return np.stack([x, y, z, w[..., 0], w[..., 1], w[..., 2]], axis=-1)


def apply(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Batched matrix (..., n, m) times vector (..., m)."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def move(T: FloatArray, point: FloatArray) -> FloatArray:
    """Points (..., 3) carried by rigid motions (..., 4, 4)."""
    return apply(T[..., :3, :3], point) + T[..., :3, 3]


def quaternion(rotation: FloatArray) -> FloatArray:
    """Unit quaternion (..., 4) = (w, x, y, z) with w >= 0, by the largest component (Shepperd)."""
    r = rotation
    trace = np.trace(r, axis1=-2, axis2=-1)
    diagonal = np.stack([r[..., i, i] for i in range(3)], axis=-1)
    pick = np.argmax(np.concatenate([trace[..., None], diagonal], axis=-1), axis=-1)
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    ww = 1.0 + trace
    xx, yy, zz = (1.0 + 2.0 * diagonal[..., i] - trace for i in range(3))
    rows = np.array([[ww, wx, wy, wz], [wx, xx, xy, xz], [wy, xy, yy, yz], [wz, xz, yz, zz]])
    chosen = np.moveaxis(np.take_along_axis(rows, pick[None, None], axis=0)[0], 0, -1)
    unit = chosen / np.linalg.norm(chosen, axis=-1, keepdims=True)
    return np.asarray(np.where(unit[..., :1] < 0.0, -unit, unit))


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Logarithm of rotations (..., 3, 3): vector (..., 3) in rad, length 0 .. pi; exact near 0 and near pi."""
    q = quaternion(rotation)
    size = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(size, q[..., :1])
    return np.asarray(np.divide(angle, size, out=np.full_like(size, 2.0), where=size > 0.0) * q[..., 1:])


def log(T: FloatArray) -> FloatArray:
    """SE(3) logarithm (..., 6) = (delta, epsilon) of rigid motions (..., 4, 4); inverse of `exp`."""
    w, p = rotation_vector(T[..., :3, :3]), T[..., :3, 3]
    c = _log_factor(np.linalg.norm(w, axis=-1, keepdims=True))
    cross = np.cross(w, p)
    return np.concatenate([p - 0.5 * cross + c * np.cross(w, cross), w], axis=-1)


def exp(xi: ArrayLike) -> FloatArray:
    """Rigid motion (..., 4, 4) of a twist (..., 6) = (delta, epsilon)."""
    v = np.asarray(xi, dtype=np.float64)
    d, w = v[..., :3], v[..., 3:]
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    first, second, third = _exp_factors(angle)
    k = hat(w)
    kk = k @ k
    return rigid(np.eye(3) + first * k + second * kk, apply(np.eye(3) + second * k + third * kk, d))


def _log_factor(angle: FloatArray) -> FloatArray:
    """(1 - (a/2) cot(a/2)) / a^2."""
    a2 = angle**2
    series = 1.0 / 12.0 + a2 * (1.0 / 720.0 + a2 * (1.0 / 30240.0 + a2 / 1209600.0))
    safe = np.where(angle < SERIES_BELOW, 1.0, angle)
    closed = (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2
    return np.asarray(np.where(angle < SERIES_BELOW, series, closed))


def _exp_factors(angle: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """sin a / a, (1 - cos a) / a^2, (a - sin a) / a^3."""
    a2, small = angle**2, angle < SERIES_BELOW
    safe = np.where(small, 1.0, angle)
    half = np.sin(0.5 * safe) / (0.5 * safe)
    first = np.where(small, _series(a2, 1, 6, 120, 5040, 362880), np.sin(safe) / safe)
    second = np.where(small, _series(a2, 2, 24, 720, 40320, 3628800), 0.5 * half**2)
    third = np.where(small, _series(a2, 6, 120, 5040, 362880, 39916800), (safe - np.sin(safe)) / safe**3)
    return first, second, third


def _series(a2: FloatArray, *factorials: int) -> FloatArray:
    """Alternating sum of a^2k / factorial_k."""
    total = np.zeros_like(a2)
    for n in reversed(factorials):
        total = 1.0 / n - a2 * total
    return total


# ---- Three-vectors and rotations kept as separate arrays, so that each part stays as small as it can (mm, rad).

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


def rpy_rows(a: FloatArray, b: FloatArray, c: FloatArray) -> Rotation:
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
