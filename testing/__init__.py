"""The kit for tests of drivers: contract suites, peers on ptys, deliveries.

It needs pytest and pytest-asyncio, the extra `testing`; only `waiting` does not.
"""

import sys

if (pytest := sys.modules.get("pytest")) is not None:
    pytest.register_assert_rewrite("traverse.testing.driver_contract")
