"""Cosine and sine in one call, uncompiled, against the library's."""

import math

import numpy as np
from numba import types

from uuv.controllers.ik.sine_cosine import _compiled_cosine_and_sine, cosine_and_sine


def test_sine_and_cosine_are_the_librarys() -> None:
    both = _compiled_cosine_and_sine(types.float64)
    angles = [
        *np.linspace(-20.0, 20.0, 401),
        *np.random.default_rng(1).uniform(-9e4, 9e4, 200),
        3e5,
        -2e7,
        0.0,
    ]
    for angle in map(float, angles):
        np.testing.assert_allclose(
            both(angle), (math.cos(angle), math.sin(angle)), rtol=0.0, atol=4e-16
        )
    single = _compiled_cosine_and_sine(types.float32)
    assert single(0.7) == cosine_and_sine(0.7) == (math.cos(0.7), math.sin(0.7))
