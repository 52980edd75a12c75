"""Eigenvalues of many small symmetric matrices: LAPACK's, and the same bits in any stack."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.control.eigen import eigen


def stack(kind: str, n: int = 6) -> np.ndarray:
    """40 symmetric matrices (40, n, n)."""
    rng = np.random.default_rng(n)
    a = rng.normal(size=(40, n, n))
    if kind == "rank 3":
        a[:, :, 3:] = 0.0
    if kind == "graded":  # as stiffness and inertia of translation and rotation
        a *= np.geomspace(1e-4, 1e3, n)[:, None]
    out = a + a.transpose(0, 2, 1) if kind == "indefinite" else a @ a.transpose(0, 2, 1)
    if kind == "plain":
        out[0], out[1], out[2], out[3] = 0.0, np.eye(n), 1.0, np.diag(np.arange(n))
        out[4, :-1, :-1] = np.eye(n - 1)
    return out


@pytest.mark.parametrize("kind", ["plain", "rank 3", "graded", "indefinite"])
@pytest.mark.parametrize("n", [2, 6, 7])
def test_values_and_vectors_are_those_of_the_matrix(kind, n):
    """V A Vᵀ is diagonal and V orthogonal; the values are LAPACK's."""
    matrix = stack(kind, n)
    values, vectors = eigen(matrix)
    size = np.abs(matrix).max(axis=(1, 2), keepdims=True) + 1e-300
    np.testing.assert_allclose(
        np.sort(values) / size[:, 0], np.linalg.eigvalsh(matrix) / size[:, 0], atol=1e-14 * n
    )
    transposed = vectors.transpose(0, 2, 1)
    np.testing.assert_allclose(vectors @ transposed, np.tile(np.eye(n), (40, 1, 1)), atol=1e-14)
    diagonal = vectors @ matrix @ transposed
    diagonal[:, range(n), range(n)] -= values
    np.testing.assert_allclose(diagonal / size, 0.0, atol=1e-14 * n)


def test_bits_do_not_depend_on_the_stack():
    """Alone, among 7 and backwards: matrices that are done wait for the others unchanged."""
    matrix = np.concatenate([stack(kind) for kind in ("plain", "rank 3", "graded")])
    values, vectors = eigen(matrix)
    for ids in (*([k] for k in range(len(matrix))), range(3, 10), range(119, -1, -1)):
        w, v = eigen(matrix[list(ids)])
        np.testing.assert_array_equal(w, values[list(ids)])
        np.testing.assert_array_equal(v, vectors[list(ids)])


def test_only_the_upper_triangle_is_read():
    matrix = stack("plain")
    upper = np.triu(matrix)
    for a, b in zip(eigen(upper), eigen(matrix), strict=True):
        np.testing.assert_array_equal(a, b)
