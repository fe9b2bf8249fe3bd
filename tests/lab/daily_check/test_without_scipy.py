"""What a daily check needs where it is collected."""

import subprocess
import sys


def test_a_check_is_planned_without_scipy():
    """It is collected on an arm's computer, which does not have it."""
    program = "import sys; sys.modules['scipy'] = None; import {}"
    subprocess.run(
        [sys.executable, "-c", program.format("traverse.lab.daily_check.figures")],
        check=True,
    )
