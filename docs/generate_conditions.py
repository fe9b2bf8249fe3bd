"""Write docs/reference/conditions.md from the table of conditions.

python docs/generate_conditions.py            writes it
python docs/generate_conditions.py --check    compares; exit status 1 if it differs
"""

import sys
from pathlib import Path

from traverse.daemon.conditions.table import CONDITIONS, Condition
from traverse.protocol.messages.quality import flag_names

PAGE = Path(__file__).resolve().parent / "reference" / "conditions.md"
HEAD = """\
# Conditions

What a number rests on. It is `ok` only while every condition that applies is
established; each is in doubt at first. This page is generated from
`daemon/conditions/table.py` (`python docs/generate_conditions.py`).

A condition of a device applies to each device that reads joints. Where it marks
samples, only the samples concerned are flagged, and it is established again when none
was for a second; else every number is flagged while it is not established.
"""


def page() -> str:
    return "\n".join([HEAD, *map(_section, CONDITIONS)])


def _section(row: Condition) -> str:
    flags = ", ".join(f"`{name}`" for name in flag_names(int(row.flags)))
    lines = {
        "Established by": row.established_by,
        "Lost by": row.lost_by,
        "Flags": f"{flags}, of {'every number' if row.marks == 'all' else 'samples'}",
        "Event": f"`{row.code}` ({row.severity}, lasting)",
        "What to do": row.remedy,
        "Command": f"`{row.command}`" if row.command else "none",
        "Kept over a restart": row.remembered or "nothing",
    }
    text = "".join(f"- {name}: {value}\n" for name, value in lines.items())
    return f"## `{row.name}`\n\nOf the {row.subject}: {row.means}.\n\n{text}"


def main() -> int:
    text = page()
    if "--check" not in sys.argv[1:]:
        PAGE.write_text(text, "utf-8")
        return 0
    return int(PAGE.read_text("utf-8") != text)


if __name__ == "__main__":
    sys.exit(main())
