"""Tables written in the dialects that people have; shares nothing with the reader."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

MINUS, EN_DASH, NO_BREAK_SPACE = "\u2212", "\u2013", "\u00a0"


@dataclass(frozen=True)
class Dialect:
    separator: str = ","
    decimal: str = "."
    group: str = ""
    decimals: int | None = None
    minus: str = "-"
    end: str = "\n"
    encoding: str = "utf-8"
    first: str = ""
    blank: str = ""
    trailing: str = ""
    trailing_header: str = ""
    comment: str = ""
    quoted: bool = False
    suffixes: dict[str, str] = field(default_factory=dict)

    def number(self, value: float | int) -> str:
        text = repr(value)
        if self.decimals is not None and isinstance(value, float):
            text = f"{value:.{self.decimals}f}"
        sign, text = ("-", text[1:]) if text.startswith("-") else ("", text)
        integer, _, part = text.partition(".")
        if self.group and integer.isdigit():
            integer = f"{int(integer):,}".replace(",", self.group)
        text = integer + (self.decimal + part if part else "")
        return (sign + text).replace("-", self.minus)

    def cell(self, value: object, column: str) -> str:
        number = isinstance(value, int | float)
        text = self.number(value) if number else str(value)
        if number:
            text += next(
                (s for end, s in self.suffixes.items() if column.endswith(end)), ""
            )
        if self.quoted or self.separator in text:
            text = '"' + text.replace('"', '""') + '"'
        return text

    def table(self, header: list[str], rows: list[tuple]) -> bytes:
        mark = self.separator + self.blank
        lines = [self.first] if self.first else []
        lines += [self.comment] if self.comment else []
        lines.append(mark.join(header) + self.trailing_header)
        for row in rows:
            cells = [self.cell(v, c) for v, c in zip(row, header, strict=True)]
            lines.append(mark.join(cells) + self.trailing)
            lines += [self.comment] if self.comment else []
        return (self.end.join(lines) + self.end).encode(self.encoding)


PLAIN = Dialect()
EXCEL = Dialect(separator=";", decimal=",", end="\r\n")

# By the names that the page of the reference has.
DIALECTS: dict[str, Dialect | Callable[[bytes], bytes]] = {
    "commas, decimal points": PLAIN,
    "`;`, decimal commas": EXCEL,
    "tabs, decimal commas": replace(EXCEL, separator="\t"),
    "`;`, decimal points": replace(EXCEL, decimal="."),
    "blanks after commas": replace(PLAIN, blank=" "),
    "a comma at the end of every line": replace(
        PLAIN, trailing=",", trailing_header=","
    ),
    "a comma at the end of rows only": replace(PLAIN, trailing=","),
    "`;;` at the end of rows": replace(EXCEL, trailing=";;"),
    "`# comment` lines, empty lines": replace(PLAIN, comment="# comment\n\n"),
    "first line `sep=;`": replace(EXCEL, first="sep=;"),
    "UTF-8 with byte order mark": replace(EXCEL, encoding="utf-8-sig"),
    "UTF-16 (Excel's Unicode text)": replace(EXCEL, separator="\t", encoding="utf-16"),
    "UTF-16 without byte order mark": replace(EXCEL, encoding="utf-16-be"),
    "line ends CR": replace(PLAIN, end="\r"),
    "every cell in quotes": replace(PLAIN, quoted=True),
    "decimal commas in quotes between commas": replace(PLAIN, decimal=","),
    "minus U+2212": replace(PLAIN, minus=MINUS),
    "minus en dash": replace(EXCEL, minus=EN_DASH),
    "degree sign in columns of degrees": replace(PLAIN, suffixes={"_deg": "°"}),
    "thousands apart, `1'234.5`": replace(PLAIN, group="'"),
    "thousands apart, `1.234,5`": replace(EXCEL, group="."),
    "thousands apart, unbreakable blank": replace(EXCEL, group=NO_BREAK_SPACE),
    "degree sign in other columns": replace(
        PLAIN, suffixes={"_rad": "°", "_mm": "°", "/0": "°"}
    ),
    "blanks between columns": replace(PLAIN, separator=" "),
    "bars between columns": replace(PLAIN, separator="|"),
    "decimal commas between commas": lambda plain: plain.replace(b".", b","),
    "decimal commas and points in one table": lambda plain: EXCEL.table(
        *columns_of(plain)
    ).replace(b",", b".", 1),
    "Windows-1252": lambda plain: plain.replace(b"\n", b" \xb0\n", 1),
    "an Excel workbook": lambda plain: b"PK\x03\x04" + plain,
}


def columns_of(plain: bytes) -> tuple[list[str], list[tuple]]:
    def value(cell: str) -> object:
        try:
            return float(cell) if "." in cell else int(cell)
        except ValueError:
            return cell

    header, *rows = (line.split(",") for line in plain.decode().splitlines())
    return header, [tuple(map(value, row)) for row in rows]


def written(name: str, header: list[str], rows: list[tuple]) -> bytes:
    dialect = DIALECTS[name]
    if isinstance(dialect, Dialect):
        return dialect.table(header, rows)
    return dialect(PLAIN.table(header, rows))
