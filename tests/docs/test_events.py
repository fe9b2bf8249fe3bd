"""Every code that the daemon can send is explained, and no other."""

import re
from pathlib import Path

CHECKOUT = Path(__file__).parent.parent.parent
PAGE = (CHECKOUT / "docs" / "reference" / "events.md").read_text("utf-8")
SUBJECTS = (
    "device command commands capture broker scan limit reload "
    "clock watchdog realtime metrics outbox resend recording replay reference"
)
CODE = re.compile(rf'"((?:{"|".join(SUBJECTS.split())})\.(?!db")[a-z_]+)"')
FAULT = re.compile(r'(?:fault|_by_node)\((?:\s*[\w.]+,)?\s*"([a-z_]+)"')


def codes_in_the_code() -> set[str]:
    found = set()
    for package in ("daemon", "drivers"):
        for path in (CHECKOUT / package).rglob("*.py"):
            text = path.read_text("utf-8")
            found |= set(CODE.findall(text))
            found |= {f"device.{name}" for name in FAULT.findall(text)}
    return found


def test_every_code_is_explained_and_no_other() -> None:
    explained = set(re.findall(r"`([a-z]+\.[a-z_]+)`", PAGE))
    of_inputs = {code for code in explained if code.startswith(("button", "switch"))}
    assert explained - of_inputs == codes_in_the_code()
