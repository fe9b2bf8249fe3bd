import re

from traverse.client.page.language import CATALOGUE, language_names

PLACEHOLDER = re.compile(r"\{#?(\d)\}")


def rows() -> list[list[str]]:
    lines = CATALOGUE.read_text("utf-8").splitlines()
    return [line.split("\t") for line in lines]


def test_each_text_is_in_all_languages_with_the_same_values():
    texts = rows()[2:]
    n_languages = len(language_names())
    assert n_languages == 5
    assert len(texts) == len({row[0] for row in texts}) > 300
    for row in texts:
        assert len(row) == n_languages, row
        assert all(cell and cell == cell.strip() for cell in row), row
        values = [sorted(set(PLACEHOLDER.findall(cell))) for cell in row]
        assert all(named == values[0] for named in values), row
