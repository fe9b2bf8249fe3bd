"""The limit of open files: raised as far as it may be, and refused where too low."""

import resource
import sys

import pytest

from tests.running import run_program

PROGRAM = """
import resource, sys
from traverse.daemon.system.open_files import ensure_open_files

resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[1]), int(sys.argv[2])))
ensure_open_files()
print(resource.getrlimit(resource.RLIMIT_NOFILE)[0])
"""
RUN = """
import resource, sys
import traverse.__main__

resource.setrlimit(resource.RLIMIT_NOFILE, (8, 8))
sys.argv = ["traverse", "run", "daemon.toml"]
traverse.__main__.main()
"""


@pytest.mark.parametrize(
    ("soft", "hard", "raised"), [(8, 2048, 1024), (70, 90, 90), (1500, 2048, 1500)]
)
def test_the_limit_is_raised_as_far_as_it_may_be(soft, hard, raised):
    assert resource.getrlimit(resource.RLIMIT_NOFILE)[1] >= hard
    done = run_program(sys.executable, "-c", PROGRAM, str(soft), str(hard))
    assert done.stdout.split() == [str(raised)]


def test_a_daemon_that_may_open_too_few_files_says_so_and_does_not_start():
    done = run_program(sys.executable, "-c", RUN, status=2)
    assert done.stderr.startswith("traverse run: this process may have 8 files")
    assert "LimitNOFILE=" in done.stderr
    assert len(done.stderr.splitlines()) == 1
