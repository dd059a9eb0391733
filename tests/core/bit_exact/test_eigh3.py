"""Eigenvectors of small symmetric matrices, compared with LAPACK's."""

import numpy as np

from firstfix.bit_exact.eigh3 import smallest_eigenvectors


def test_eigenvalues_and_the_smallest_ones_axis():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(500, 8, 3)) * rng.uniform(0.001, 2, (500, 1, 3))
    matrices = np.einsum("nki,nkj->nij", points, points)
    values, axes = smallest_eigenvectors(matrices)
    wanted, vectors = np.linalg.eigh(matrices)
    np.testing.assert_allclose(values, wanted, atol=1e-9 * wanted.max())
    assert np.abs(np.einsum("ni,ni->n", axes, vectors[:, :, 0])).min() > 1 - 1e-9
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1, atol=1e-12)


def test_what_is_diagonal_already_and_nothing_at_all():
    values, axes = smallest_eigenvectors(np.stack([np.diag([3.0, 1.0, 2.0]), np.zeros((3, 3))]))
    assert values.tolist() == [[1, 2, 3], [0, 0, 0]]
    assert axes.tolist() == [[0, 1, 0], [1, 0, 0]]
    assert smallest_eigenvectors(np.empty((0, 3, 3)))[1].shape == (0, 3)
