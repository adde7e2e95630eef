import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.cell.config.units import quantity, to_si


@pytest.mark.parametrize(
    ("given", "dimension", "value"),
    [
        ("-94 deg", "angle", math.radians(-94)),
        ("90°", "angle", math.pi / 2),
        ("1 rad", "angle", 1.0),
        (" 50mm ", "length", 0.05),
        ("2.5 cm", "length", 0.025),
        ("0.02 m", "length", 0.02),
        ("12 ms", "time", 0.012),
        ("1e-3 s", "time", 0.001),
        ("156 deg/s", "angle/s", math.radians(156)),
        ("2.5 m/s", "length/s", 2.5),
        ("+10 rad/s2", "angle/s²", 10.0),
        ("10 rad/s^2", "angle/s²", 10.0),
        ("6.81 m/s²", "length/s²", 6.81),
        (3, "length", 3.0),
        (-0.5, "angle", -0.5),
    ],
)
def test_numbers_and_texts_are_read(given, dimension, value):
    assert to_si(given, dimension) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "given", [True, None, [1.0], {}, "", "deg", "1", "1 2 m", "one m", "1 m/s3", "1 deg/m"]
)
def test_invalid_quantities_are_refused(given):
    with pytest.raises(ValueError, match="expected"):
        quantity(given)


@pytest.mark.parametrize("given", ["3 furlong", "3 s/s", "3 M"])
def test_unknown_units_are_listed(given):
    with pytest.raises(ValueError, match=r"unknown unit .*; expected one of rad or deg"):
        quantity(given)


@pytest.mark.parametrize("given", [math.nan, math.inf, -math.inf, "1e999 m"])
def test_numbers_that_are_not_finite_are_refused(given):
    with pytest.raises(ValueError, match="is not finite; expected a finite number"):
        quantity(given)


def test_a_wrong_dimension_is_refused_with_the_right_units():
    with pytest.raises(
        ValueError, match=r"'3 deg' is not a length; expected a number or a unit of m, cm or mm"
    ):
        to_si("3 deg", "length")
    with pytest.raises(ValueError, match="expected a number or a unit of rad/s or deg/s"):
        to_si("3 deg", "angle/s")


def test_a_bare_number_fits_every_dimension():
    assert quantity(2).fits("angle")
    assert quantity(2).fits("length/s²")
    assert not quantity("2 m").fits("angle")


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_si_units_keep_the_value(value):
    assert to_si(f"{value!r} rad", "angle") == value
    assert to_si(value, "time") == value


def test_reading_twice_gives_the_same_quantity():
    read = quantity("3 mm")
    assert quantity(read) is read
    assert read.given == "3 mm"


@pytest.mark.parametrize("text", ["٦٠٠ mm", "６ m", "6_0 mm", "600\u00a0mm"])
def test_only_ascii_digits_are_numbers(text):
    with pytest.raises(ValueError, match="cannot read"):
        quantity(text)
