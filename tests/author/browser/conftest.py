"""Pages need a browser."""

import pytest

from tests.author.browser.running import why_not


@pytest.fixture(scope="session", autouse=True)
def browser():
    """Skips where there is none."""
    reason = why_not()
    if reason:
        pytest.skip(reason)
