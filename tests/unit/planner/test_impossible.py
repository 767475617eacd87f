"""What cannot be done is refused for its one reason, in one line, with what to do about it; never half done."""

from __future__ import annotations

import re

import pytest

from planner.errors import PostError
from tests.unit.planner.impossible import CASES, Case


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name.replace(" ", "_"))
def test_it_is_refused_for_its_reason(case: Case) -> None:
    with pytest.raises(PostError) as caught:
        case.run()
    error = caught.value
    assert re.search(case.reason, error.message), error.message
    assert re.search(case.hint, error.hint), error.hint
    assert "\n" not in error.message + error.hint and len(error.message) < 400
