"""Elementary functions: near the truth, and the same bits everywhere."""

from __future__ import annotations

import hashlib
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core import elementary

ANGLES = np.concatenate(
    [np.linspace(-7.0, 7.0, 701), np.linspace(-1e5, 1e5, 201), np.linspace(-1e-3, 1e-3, 51)]
)
FUNCTIONS = {
    "sine": (lambda x: elementary.sincos(x)[0], mpmath.sin, ANGLES, 2.0),
    "cosine": (lambda x: elementary.sincos(x)[1], mpmath.cos, ANGLES, 2.0),
    "arccos": (elementary.arccos, mpmath.acos, np.linspace(-1.0, 1.0, 501), 5.0),
    "exp": (elementary.exp, mpmath.exp, np.linspace(-700.0, 700.0, 501), 2.0),
    "log": (elementary.log, mpmath.log, np.geomspace(1e-300, 1e300, 501), 2.0),
}


def ulps(found: float, true: mpmath.mpf) -> float:
    return float(abs(mpmath.mpf(found) - true) / mpmath.mpf(float(np.spacing(abs(float(true))))))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_is_within_a_few_last_bits_of_the_true_value(name):
    function, true, arguments, bound = FUNCTIONS[name]
    with mpmath.workprec(200):
        errors = [
            ulps(found, true(mpmath.mpf(x)))
            for found, x in zip(function(arguments).tolist(), arguments.tolist(), strict=True)
        ]
    assert max(errors) < bound


def test_arctan2_is_within_a_few_last_bits_in_every_direction():
    angles = np.linspace(-3.1, 3.1, 999)
    y, x = 3.0 * np.sin(angles), 3.0 * np.cos(angles)
    with mpmath.workprec(200):
        true = [mpmath.atan2(mpmath.mpf(b), mpmath.mpf(a)) for b, a in zip(y, x, strict=True)]
        found = elementary.arctan2(y, x).tolist()
        assert max(map(ulps, found, true)) < 5.0


@pytest.mark.parametrize(
    ("y", "x", "angle"),
    [
        (0.0, 1.0, 0.0),
        (1.0, 0.0, math.pi / 2),
        (0.0, -1.0, math.pi),
        (-1.0, 0.0, -math.pi / 2),
        (0.0, 0.0, 0.0),
    ],
)
def test_arctan2_on_the_axes(y, x, angle):
    assert elementary.arctan2(y, x) == angle


def test_exact_values_are_exact():
    sine, cosine = elementary.sincos(0.0)
    assert (sine, cosine, elementary.exp(0.0), elementary.log(1.0)) == (0.0, 1.0, 1.0, 0.0)
    assert elementary.arccos(1.0) == 0.0


@given(st.floats(-1e5, 1e5))
def test_sine_and_cosine_lie_on_the_circle(angle):
    sine, cosine = elementary.sincos(angle)
    assert abs(sine * sine + cosine * cosine - 1.0) < 1e-15


def test_an_angle_too_large_to_be_reduced_is_refused():
    with pytest.raises(ValueError, match="angle 200000"):
        elementary.sincos([0.0, 2e5])


def test_nan_stays_nan():
    assert np.isnan(elementary.sincos(math.nan)).all()


def test_any_shape_comes_back_as_it_is():
    for shape in ((), (3,), (2, 3), (0,)):
        assert all(part.shape == shape for part in elementary.sincos(np.ones(shape)))


def test_normal_numbers_are_numpys_to_single_precision():
    drawn = elementary.normal(np.random.default_rng(3), (400, 5))
    numpys = np.random.default_rng(3).standard_normal((400, 5))
    assert drawn.tobytes() == numpys.astype(np.float32).astype(np.float64).tobytes()


def test_the_bits_are_those_of_every_other_machine():
    """The digest is of IEEE arithmetic: it may differ on no machine and in no version."""
    x = np.arange(-2000.0, 2000.0) / 128.0
    parts = [
        *elementary.sincos(x),
        elementary.arctan2(x, x[::-1] + 0.5),
        elementary.arccos(x / 16.0),
        elementary.exp(x),
        elementary.log(x + 16.0),
    ]
    content = b"".join(np.asarray(part, "<f8").tobytes() for part in parts)
    assert hashlib.sha256(content).hexdigest()[:16] == "de384a51e518b4a4"
