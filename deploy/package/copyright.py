"""Write a Debian package's copyright file: licences of Traverse and of its contents.

Each distribution below its root states its licence in its metadata; texts are copied.
Ends with status 1 if one states none.
"""

import argparse
import re
import sys
from email.parser import HeaderParser
from pathlib import Path

# Texts that every Debian has, as they begin and end.
COMMON = {
    "Apache-2.0": r"Apache License\s+Version 2\.0, .*?END OF TERMS AND CONDITIONS",
    "GPL-3": r"GNU GENERAL PUBLIC LICENSE\s+Version 3, .*?why-not-lgpl\.html>\.?",
}
TEXTS = ("LICENSE*", "LICENCE*", "COPYING*", "NOTICE*", "AUTHORS*")


def licence_of(metadata: Path) -> tuple[str, str]:
    """Return name and version, and the licence, of a distribution's METADATA.

    Raises:
        ValueError: it states no licence.
    """
    headers = HeaderParser().parsestr(metadata.read_text("utf-8"))
    name = f"{headers['Name']} {headers['Version']}"
    classifiers = [
        value.rpartition(" :: ")[2]
        for value in headers.get_all("Classifier", [])
        if value.startswith("License :: ")
    ]
    stated = headers["License-Expression"] or ", ".join(classifiers)
    stated = stated or (headers["License"] or "").strip().partition("\n")[0]
    if not stated and not texts_of(metadata.parent):
        raise ValueError(f"{metadata}: states no licence")
    return name, stated or "see its text below"


def texts_of(info: Path) -> list[Path]:
    """Return the files with licences in a distribution's folder of metadata."""
    return sorted(
        {file for form in TEXTS for file in info.rglob(form) if file.is_file()}
    )


def text_of(file: Path) -> str:
    """Return the text of licences, without those that every Debian has."""
    text = file.read_text("utf-8", "replace")
    for name, form in COMMON.items():
        place = f"(see /usr/share/common-licenses/{name})"
        text = re.sub(form, place, text, flags=re.DOTALL)
    return text


def main(licence: Path, package: str, root: Path) -> None:
    """Write ROOT/usr/share/doc/PACKAGE/copyright."""
    parts = ["Traverse is licensed as follows.", text_of(licence)]
    for metadata in sorted(root.rglob("*.dist-info/METADATA")):
        name, stated = licence_of(metadata)
        parts.append(f"{name}: {stated}")
        parts += [
            f"{name}, {file.name}:\n\n{text_of(file)}"
            for file in texts_of(metadata.parent)
        ]
    target = root / "usr" / "share" / "doc" / package / "copyright"
    target.parent.mkdir(parents=True, exist_ok=True)
    rule = "\n" + "-" * 78 + "\n\n"
    target.write_text(rule.join(part.strip() + "\n" for part in parts), "utf-8")
    target.chmod(0o644)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("licence", type=Path)
    parser.add_argument("package")
    parser.add_argument("root", type=Path)
    try:
        main(**vars(parser.parse_args()))
    except ValueError as error:
        sys.exit(str(error))
