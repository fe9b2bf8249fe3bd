"""The kit for tests of drivers: contract suites, peers on ptys, deliveries.

It needs pytest and pytest-asyncio, the extra `testing`.
"""

import pytest

pytest.register_assert_rewrite("traverse.testing.driver_contract")
