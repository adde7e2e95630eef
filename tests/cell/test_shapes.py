import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.cell.errors import ModelError
from armgate.cell.shapes import Box, Capsule, Cylinder, Sphere, shape_from

sizes = st.floats(0.001, 5.0)
shapes = st.one_of(
    st.builds(Sphere, sizes),
    st.builds(Capsule, sizes, sizes),
    st.builds(Cylinder, sizes, sizes),
    st.builds(Box, sizes, sizes, sizes),
)
directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: math.hypot(*d) > 1e-3)


def support(shape, direction):
    """Return the distance of the shape's farthest point along a direction, without ``core``."""
    d = np.array(direction) / math.hypot(*direction)
    flat = math.hypot(d[0], d[1])
    match shape:
        case Sphere(radius=r):
            return r
        case Capsule(radius=r, length=length):
            return r + abs(d[2]) * length / 2
        case Cylinder(radius=r, length=length):
            return r * flat + abs(d[2]) * length / 2
        case Box(x=x, y=y, z=z):
            return (abs(d[0]) * x + abs(d[1]) * y + abs(d[2]) * z) / 2


@given(shapes, directions)
def test_the_core_contains_the_shape(shape, direction):
    d = np.array(direction) / math.hypot(*direction)
    by_core = max(float(np.dot(point, d)) for point in shape.core) + shape.core_radius
    assert by_core >= support(shape, direction) - 1e-12
    if not isinstance(shape, Cylinder):
        assert by_core == pytest.approx(support(shape, direction))


@given(shapes, directions)
def test_the_bounding_ball_contains_the_shape(shape, direction):
    assert shape.bounding_radius >= support(shape, direction) - 1e-12


@pytest.mark.parametrize(
    ("shape", "farthest"),
    [
        (Sphere(0.1), 0.1),
        (Capsule(0.1, 0.6), 0.4),
        (Cylinder(0.3, 0.8), 0.5),
        (Box(0.2, 0.4, 0.4), 0.3),
    ],
)
def test_the_bounding_radius_is_the_smallest_one(shape, farthest):
    assert shape.bounding_radius == pytest.approx(farthest)


@given(shapes)
def test_kind_and_size_give_the_same_shape(shape):
    assert shape_from(shape.kind, shape.size) == shape


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan, math.inf])
def test_sizes_must_be_positive_numbers(size):
    with pytest.raises(ModelError, match="expected a positive number of metres"):
        Capsule(0.1, size)


def test_unknown_kinds_and_wrong_numbers_of_sizes_are_refused():
    with pytest.raises(
        ModelError, match="unknown shape 'prism'; expected one of sphere, capsule, cylinder, box, cone"
    ):
        shape_from("prism", [1.0])
    with pytest.raises(ModelError, match=r"a capsule with 1 size\(s\); expected radius, length"):
        shape_from("capsule", [1.0])
