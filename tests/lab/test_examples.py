"""The examples in docstrings of the lab's entry points run as they stand."""

import doctest
from importlib import import_module

import pytest

ENTRY_POINTS = (
    "acceptance.budget",
    "identification.identify",
    "identification.prediction",
    "diagnosis.diagnose",
    "outcomes.base",
)


@pytest.mark.parametrize("name", ENTRY_POINTS)
def test_examples_print_what_they_say(name):
    tried = doctest.testmod(import_module(f"traverse.lab.{name}"))
    assert tried.attempted > 3
    assert tried.failed == 0
