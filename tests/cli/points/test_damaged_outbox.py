"""Outboxes with any damage: reported in a sentence, never as a traceback."""

import random

import pytest

from tests.daemon.store.test_damage import SESSION, make
from tests.running import invoke

HARMS = {
    "bits": lambda chance, content: [
        flip(chance, content, chance.randrange(len(content)))
        for _ in range(chance.randrange(1, 30))
    ],
    "cut": lambda chance, content: content.__delitem__(
        slice(chance.randrange(len(content)), None)
    ),
    "header": lambda chance, content: flip(chance, content, chance.randrange(2000)),
}


def flip(chance, content, place):
    content[place] ^= 1 << chance.randrange(8)


@pytest.mark.slow
@pytest.mark.parametrize("harm", HARMS)
def test_no_damage_ends_a_command_with_a_traceback(harm, tmp_path):
    good, bad = tmp_path / "good.db", tmp_path / "bad.db"
    make(good)
    out = str(tmp_path / "out.csv")
    for seed in range(20):
        content = bytearray(good.read_bytes())
        HARMS[harm](random.Random(seed), content)
        bad.write_bytes(content)
        for words in (
            ["export", str(bad), "--to", "csv", "--force", "--out", out],
            ["points", "list", "--db", str(bad)],
            ["points", "list", "--db", str(bad), "--session", SESSION],
            ["points", "export", "--db", str(bad), "--out", out, "--force"],
        ):
            done = invoke(*words, status=None)
            assert isinstance(done.exception, SystemExit | None), (seed, words)
            assert done.exit_code in (0, 1, 2), (seed, words)
