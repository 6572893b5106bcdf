"""Derivatives carried along are those of the closed form."""

from __future__ import annotations

import numpy as np

from polish_sim.motion.spline.curve import cross, dot, inverse_root, normalized

T = np.linspace(0.0, 3.0, 7)
ZERO = np.zeros_like(T)
GROWING = np.exp(2.0 * T)


def circle() -> np.ndarray:
    """(cos t, sin t, 0) and three derivatives."""
    return np.stack([np.stack([np.cos(T + k * np.pi / 2), np.sin(T + k * np.pi / 2), ZERO], axis=1) for k in range(4)])


def test_the_inverse_root_of_an_exponential_is_an_exponential() -> None:
    found = inverse_root(np.stack([2.0**k * GROWING for k in range(4)]))
    np.testing.assert_allclose(found, [(-1.0) ** k * np.exp(-T) for k in range(4)], rtol=1e-12)


def test_a_growing_spiral_normalized_is_the_circle() -> None:
    # Derivatives of e^t (cos t, sin t): turned by 45 deg and longer by sqrt 2 each time.
    spiral = np.stack([
        2.0 ** (k / 2) * np.exp(T)[:, None]
        * np.stack([np.cos(T + k * np.pi / 4), np.sin(T + k * np.pi / 4), ZERO], axis=1)
        for k in range(4)
    ])  # fmt: skip
    np.testing.assert_allclose(normalized(spiral), circle(), atol=1e-12)


def test_products_of_a_circle_with_itself_are_constant() -> None:
    c = circle()
    np.testing.assert_allclose(dot(c, c), [ZERO + 1.0, ZERO, ZERO, ZERO], atol=1e-12)
    turning = cross(c[:3], c[1:])
    np.testing.assert_allclose(turning[0], np.tile([0.0, 0.0, 1.0], (len(T), 1)), atol=1e-12)
    np.testing.assert_allclose(turning[1:], 0.0, atol=1e-12)
