import contextlib
import os
import re
import signal
import subprocess

import pytest

from tests import programs
from tests.docs.pages import CHECKOUT

END_S = 400.0
MAKEFILE = (CHECKOUT / "Makefile").read_text("utf-8")
# Targets of benchmarks, proofs and packages, and what each is made from.
TARGETS = dict(
    re.findall(
        r"^((?:audit|bench|blind|deb|endurance|fuzz|honesty|prove|screenshots|soak|wheels)"
        r"[a-z-]*):([^#\n]*)",
        MAKEFILE,
        re.MULTILINE,
    )
)
# Groups of Debian packages that `make system` asks for.
(GROUPS,) = re.findall(r"^TEST_GROUPS := (.*)$", MAKEFILE, re.MULTILINE)
# What a target leaves in BUILD, if anything.
LEAVES = {
    "bench": ("figures/performance-path.png", "figures/performance-presses.png"),
    "blind": ("blind.jsonl",),
    "deb": ("traverse_*.deb", "traverse-lab_*.deb", "traverse-fleet_*.deb"),
    "honesty": ("honesty.jsonl",),
    "prove": ("proofs.jsonl",),
    "prove-acceptance": ("acceptance.jsonl", "figures/acceptance-truth.png"),
    "prove-alignment": ("alignment.jsonl", "figures/alignment-index.png"),
    "wheels": ("*_x86_64.whl", "*_aarch64.whl", "*.tar.gz"),
    "screenshots": ("figures/reports/certificate.png", "figures/live-view.png"),
}
# Without the network nobody can be asked: no all-clear, and no mistake of the program.
UNANSWERED = "nobody could be asked"


def changed():
    """Files that differ from the commit; nothing where there is no repository."""
    if not (CHECKOUT / ".git").exists():
        return ""
    words = ["git", "status", "--porcelain"]
    return subprocess.run(
        words, cwd=CHECKOUT, capture_output=True, text=True, check=True
    ).stdout


def test_all_targets_are_found():
    assert len(TARGETS) >= 22
    assert LEAVES.keys() | LONG <= TARGETS.keys()


# Half a minute or more, or other libraries and programs: `make test-targets` alone.
LONG = frozenset(
    {
        *("audit", "bench", "bench-capture", "bench-drivers", "bench-fleet"),
        "blind-full",  # the programs of `blind`, longer
        *("bench-kernel", "bench-page", "bench-recording", "bench-zoo", "deb", "fuzz"),
        *("screenshots", "wheels"),
    }
)


def marks(target, prerequisites):
    groups = GROUPS.split() if "system" in prerequisites else ()
    long = (pytest.mark.targets,) if target in LONG else ()
    return (pytest.mark.needs(*groups), *long)


@pytest.mark.slow
@pytest.mark.timeout(END_S + 20.0)
@pytest.mark.parametrize(
    "target",
    [
        pytest.param(name, marks=marks(name, made_from))
        for name, made_from in TARGETS.items()
    ],
)
def test_target_runs_in_a_tiny_size(target, tmp_path):
    before = changed()
    # Not a part of the make that may run this; under pytest the page does not start.
    outer = ("MAKE", "PYTEST_")
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(outer)}
    # It installs what it needs, and finds it as a user does.
    inherited["PATH"] = programs.EVERYWHERE
    options = ("TINY=1", f"BUILD={tmp_path}", f"DIST={tmp_path}")
    with subprocess.Popen(
        ["make", target, *options],
        cwd=CHECKOUT,
        env=inherited,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # to be ended with all that it has started
    ) as running:
        try:
            out, errors = running.communicate(timeout=END_S)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(running.pid, signal.SIGKILL)
    assert running.returncode == 0 or UNANSWERED in out, (out, errors)
    assert "Traceback" not in errors
    for pattern in LEAVES.get(target, ()):
        assert list(tmp_path.glob(pattern)), pattern
    assert changed() == before
