"""Compact encoding of plans: exact to the last bit, and complete for other plans."""

import struct

from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from pydantic_core import from_json, to_json

from armgate.events import Plan, PlanKey
from armgate.gate.braking import stop_increments
from armgate.recording import plans

KEY = PlanKey("start", 0, 7, -1)
numbers = st.floats(-0.05, 0.05)
joints = st.lists(numbers, min_size=1, max_size=9)


def bits(increments):
    return [struct.pack(f"{len(row)}d", *row) for row in increments]


def round_trip(increments):
    plan = Plan("R", KEY, 3, tuple(map(tuple, increments)))
    value = from_json(to_json(plans.packed(plan)))
    Draft202012Validator(plans.schema()).validate(value)
    again = plans.unpacked(value)
    assert bits(again.increments) == bits(plan.increments)
    assert (again.robot, again.key, again.seq) == ("R", KEY, 3)
    return value


@given(joints, st.floats(1e-5, 0.02))
def test_a_stop_survives_a_round_trip_to_the_last_bit(u, decel):
    round_trip(stop_increments(u, [decel] * len(u)))


def test_a_long_stop_is_stored_in_three_values():
    u = [0.001 * (1 + k) / 3 for k in range(9)]
    value = round_trip(stop_increments(u, [1e-5] * 9))
    assert (value["then"] > 200, "increments" in value) == (True, False)


@given(st.integers(1, 6).flatmap(lambda n: st.lists(st.lists(numbers, min_size=n, max_size=n), max_size=6)))
def test_other_plans_are_stored_completely(increments):
    round_trip(increments)


def test_the_sign_of_a_zero_survives():
    value = round_trip([(1.0, -0.0), (0.5, 0.0)])
    assert "increments" in value
