"""Targets of benchmarks, proofs and packages run, and leave the checkout as it was."""

import os
import re
import subprocess

import pytest

from tests.docs.pages import CHECKOUT

END_S = 600.0
BROKER = ("mosquitto",)
# Groups of Debian packages that a target needs.
TARGETS = {
    "audit": (),
    "bench": BROKER,
    "bench-capture": BROKER,
    "bench-client": BROKER,
    "bench-drivers": (),
    "bench-fleet": BROKER,
    "bench-identification": (),
    "bench-kernel": (),
    "bench-page": (*BROKER, "chromium"),
    "bench-recording": BROKER,
    "blind": (),
    "blind-full": (),
    "deb": (),
    "docs": (),
    "endurance": BROKER,
    "fuzz": (),
    "fuzz-files": (),
    "honesty": (),
    "prove": (),
    "prove-acceptance": (),
    "prove-alignment": (),
    "screenshots": (*BROKER, "chromium", "xvfb"),
    "soak": BROKER,
}
KINDS = re.compile(
    r"^((?:audit|bench|blind|deb|docs|endurance|fuzz|honesty|prove|screenshots|soak)[a-z-]*):",
    re.MULTILINE,
)
# What a target leaves in BUILD, if anything.
LEAVES = {
    "bench": ("figures/performance-path.png", "figures/performance-latency.png"),
    "blind": ("blind.jsonl",),
    "deb": ("traverse_*.deb", "traverse-lab_*.deb"),
    "docs": ("site/index.html",),
    "honesty": ("honesty.jsonl",),
    "prove": ("proofs.jsonl",),
    "prove-acceptance": ("acceptance.jsonl", "figures/acceptance-truth.png"),
    "prove-alignment": ("alignment.jsonl", "figures/alignment-index.png"),
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


def test_every_target_of_these_kinds_is_run():
    makefile = (CHECKOUT / "Makefile").read_text("utf-8")
    assert sorted(KINDS.findall(makefile)) == sorted(TARGETS)
    assert LEAVES.keys() <= TARGETS.keys()


@pytest.mark.slow
@pytest.mark.parametrize(
    "target",
    [pytest.param(n, marks=pytest.mark.needs(*g)) for n, g in TARGETS.items()],
)
def test_target_runs_in_a_tiny_size(target, tmp_path):
    before = changed()
    # Not a part of the make that may run this.
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}
    options = ("TINY=1", f"BUILD={tmp_path}", f"SITE={tmp_path}/site")
    ran = subprocess.run(
        ["make", target, *options],
        cwd=CHECKOUT,
        env=inherited,
        capture_output=True,
        text=True,
        timeout=END_S,
        check=False,
    )
    assert ran.returncode == 0 or UNANSWERED in ran.stdout, (ran.stdout, ran.stderr)
    assert "Traceback" not in ran.stderr
    for pattern in LEAVES.get(target, ()):
        assert list(tmp_path.glob(pattern)), pattern
    assert changed() == before
