import json
import re
from typing import Any

import pytest

from tests.docs.pages import CHECKOUT, text_of
from tests.running import invoke
from traverse.lab.alignment.nominal import Nominal
from traverse.strict_toml.reader import read_strict

PAGE = "docs/alignment.md"
LEFT_OUT = ("", "CDF", "CDEF")  # of each of the three outputs


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", text_of(PAGE), re.DOTALL)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    nominal, touched = blocks("csv")
    (tmp_path / "part.csv").write_text(nominal)
    (tmp_path / "touched.csv").write_text(touched)
    monkeypatch.chdir(tmp_path)
    return tmp_path


FLAG = re.compile(r'AlignmentWarning\(\s*"(\w+)"')


def aligned(*words: str) -> tuple[int, str]:
    arguments = [
        "align",
        "touched.csv",
        "--nominal",
        "part.csv",
        "--std",
        "0.025",
        *words,
    ]
    result = invoke(*arguments, status=None)
    return result.exit_code, result.output


@pytest.mark.parametrize("number", range(3))
def test_the_example_prints_what_the_page_shows(folder, number):
    touched = (folder / "touched.csv").read_text().splitlines()
    kept = [line for line in touched if line[0] not in LEFT_OUT[number]]
    (folder / "touched.csv").write_text("\n".join(kept) + "\n")
    status, text = aligned()
    assert status == (2 if number == 2 else 0)
    assert text == blocks("text")[number]


def test_the_nominal_file_shown_is_good(tmp_path):
    (text,) = blocks("toml")
    file = tmp_path / "part.toml"
    file.write_text(text)
    assert read_strict(file, Nominal).name == "bracket"


def keys_of(values: Any) -> set[str]:
    if isinstance(values, dict):
        return set(values).union(*map(keys_of, values.values()))
    if isinstance(values, list):
        return set().union(*map(keys_of, values))
    return set()


def test_every_key_and_flag_stands_on_the_page(folder):
    values = json.loads(aligned("--json")[1])
    page = text_of(PAGE)
    arm_keys = {"schema", "action", "place_mm", "rms_mm", "covariance_mm2", "source"}
    missing = {key for key in keys_of(values) - arm_keys if f"`{key}`" not in page}
    assert missing <= {"min_mm", "max_mm"}
    sources = (CHECKOUT / "lab" / "alignment").glob("*.py")
    codes = {
        code for source in sources for code in FLAG.findall(source.read_text("utf-8"))
    }
    assert len(codes) == 16
    assert {code for code in codes if f"| `{code}` |" not in page} == set()
