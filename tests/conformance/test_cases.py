"""Every MUST about the server has a case, and every case belongs to a statement."""

import re
from functools import partial

import pytest

from armgate.conformance.case import cases, select_cases
from armgate.protocol.spec_statements import Level, When, statements

MUSTS = [s for s in statements().values() if s.about_server and s.level is Level.MUST]
TRIED = {id_ for case in cases() for id_ in case.covers}


@pytest.mark.parametrize("statement", MUSTS, ids=lambda s: s.id)
def test_every_must_about_the_server_is_tested(statement):
    assert statement.id in TRIED, f"no case tests {statement.id}: {statement.text}"


def test_every_case_names_statements_about_the_server():
    for case in cases():
        for id_ in case.covers:
            assert id_ in statements(), f"{case.id}: no statement {id_}"
            assert statements()[id_].about_server, f"{case.id}: {id_} does not bind the server"


def test_every_case_has_a_description_and_an_expectation():
    for case in cases():
        assert re.fullmatch(r"[A-Z]{3}-\d+/[a-z0-9-]+", case.id), case.id
        assert len(case.description) > 10, case.id
        assert len(case.expectation) > 4, case.id


def test_the_functions_of_cases_have_unique_names():
    functions = {body.func if isinstance(body, partial) else body for body in (case.body for case in cases())}
    names = [function.__name__ for function in functions]
    assert len(names) > 200
    assert "_" not in names
    assert len(names) == len(set(names)), sorted(name for name in names if names.count(name) > 1)


def test_the_number_of_cases():
    assert len(cases()) == len({case.id for case in cases()})
    assert len(cases()) > 200
    assert sum(case.when is When.LOCKSTEP for case in cases()) > 12


def test_a_case_covers_statements_of_one_mode_only():
    modes = (When.CLOCK, When.LOCKSTEP)
    for case in cases():
        found = {statements()[id_].when for id_ in case.covers}
        assert not set(modes) <= found, case.id


@pytest.mark.parametrize(
    ("names", "least"), [(["LEA-8/takeover"], 1), (["FRM-5"], 3), (["LEA"], 20), (["FRM-5", "LEA-8"], 4)]
)
def test_cases_are_chosen_by_id_statement_and_topic(names, least):
    found = select_cases(names)
    assert len(found) >= least
    assert all(any(case.id.startswith(name) for name in names) for case in found)


def test_a_name_that_matches_no_case_is_an_error():
    with pytest.raises(LookupError, match="FRM-999"):
        select_cases(["FRM-1", "FRM-999"])
