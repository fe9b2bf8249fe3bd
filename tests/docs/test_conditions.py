import sys

from tests.docs.pages import CHECKOUT
from tests.running import run_program


def test_the_page_is_made_from_the_table() -> None:
    """`python docs/generate_conditions.py` writes it anew."""
    program = CHECKOUT / "docs" / "generate_conditions.py"
    run_program(sys.executable, program, "--check", status=0)
