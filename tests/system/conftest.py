"""One running star for the tests that leave it as they found it."""

from collections.abc import Iterator

import pytest

from benchmarks.running_star import RunningStar
from tests.system.noting_simulator import NOTING

CURRENT = "[simulator]\ncurrent_x_m_s = 0.07\ncurrent_y_m_s = 0.03\n"


@pytest.fixture(scope="module")
def star() -> Iterator[RunningStar]:
    with RunningStar(CURRENT, system=NOTING) as running:
        yield running
