"""Table of error codes, and errors as messages."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.protocol import CODES, ErrorCode, LocalProtocolError, ProtocolError, RemoteProtocolError, errors
from armgate.protocol.messages import Error


def test_every_code_has_a_row_and_advice():
    assert set(CODES) == set(ErrorCode)
    assert all(row.meaning and row.advice for row in CODES.values())


@pytest.mark.parametrize("code", ErrorCode)
def test_an_error_is_fatal_as_in_the_table_unless_overridden(code):
    assert RemoteProtocolError(code, "x").fatal is CODES[code].fatal
    assert RemoteProtocolError(code, "x", fatal=True).message().fatal is True
    assert RemoteProtocolError(code, "x", fatal=False).message().fatal is False


@given(st.text(max_size=2000), st.none() | st.text(max_size=100))
def test_any_text_fits_into_a_message(text, about):
    message = ProtocolError(ErrorCode.INTERNAL, text, about=about).message()
    assert len(message.text) <= 512
    assert message.text.startswith(text[:511])
    assert message.about in (None, about)


def test_the_message_has_all_fields_of_the_error():
    error = RemoteProtocolError(ErrorCode.UNKNOWN_ROBOT, "no robot X", about="command", seq=4, re=2)
    expected = Error(code="unknown_robot", text="no robot X", fatal=False, about="command", seq=4, re=2)
    assert error.message() == expected
    assert str(error) == "unknown_robot: no robot X"


def test_the_docstring_lists_all_exceptions():
    classes = {c for c in vars(errors).values() if isinstance(c, type) and issubclass(c, Exception)}
    assert classes == {ProtocolError, LocalProtocolError, RemoteProtocolError}
    assert all(issubclass(c, ProtocolError) and c.__name__ in errors.__doc__ for c in classes)
