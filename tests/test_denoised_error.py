"""Shuffling of errors, by which docs/denoised_error.py tells what correlation costs."""

from __future__ import annotations

import numpy as np
from denoised_error import shuffled


def test_a_block_keeps_its_pixels_and_loses_their_order() -> None:
    random = np.random.default_rng(1)
    image = random.random((10, 13, 3))
    result = shuffled(image, 4, random)
    assert np.mean(np.any(result != image, axis=-1)) > 0.7
    for y in range(0, 10, 4):
        for x in range(0, 13, 4):
            parts = [a[y : y + 4, x : x + 4].reshape(-1, 3) for a in (image, result)]
            ordered = [part[np.lexsort(part.T)] for part in parts]
            np.testing.assert_array_equal(*ordered)


def test_blocks_of_a_pixel_change_nothing() -> None:
    image = np.random.default_rng(2).random((3, 5, 3))
    np.testing.assert_array_equal(shuffled(image, 1, np.random.default_rng(3)), image)
