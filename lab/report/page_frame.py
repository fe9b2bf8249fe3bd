"""What all pages have around their sections: title, look, navigation, one file."""

from collections.abc import Iterable, Mapping
from html import escape

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff;
       max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; } h2 { font-size: 1.15rem; margin-top: 2.2rem;
     border-bottom: 1px solid #ccc; padding-bottom: .2rem; }
.verdict { border-left: .4rem solid #0072B2; padding: .2rem 1rem; background: #f4f7fa; }
.verdict.bad { border-color: #D55E00; background: #fdf3ec; }
.note { color: #555; font-size: .85rem; }
figure { margin: 1rem 0; } img { max-width: 100%; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .85rem; margin: .8rem 0; }
th, td { padding: .18rem .8rem .18rem 0; text-align: left; vertical-align: top;
         border-bottom: 1px solid #e4e4e4; }
th { border-bottom: 1px solid #777; }
.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th.number { white-space: normal; }
nav a { margin-right: 1rem; white-space: nowrap; font-size: .85rem; }
@media print { nav { display: none; } section { break-inside: avoid-page; } }
"""


def framed(title: str, parts: Iterable[str], style: str = "") -> str:
    """Make a whole page.

    Args:
        title: Of the window, and its first heading.
        parts: HTML, in order; empty ones are left out.
        style: Rules of this page besides those of all.
    """
    heading = escape(title)
    body = "\n".join([f"<h1>{heading}</h1>", *(part for part in parts if part)])
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{heading}</title>\n<style>{_STYLE}{style}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )


def navigation(contents: Mapping[str, str]) -> str:
    """Links to sections, by the id of each."""
    links = "".join(f'<a href="#{name}">{text}</a>' for name, text in contents.items())
    return f"<nav>{links}</nav>"
