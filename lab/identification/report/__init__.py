"""The report of an identification: words, pictures and one page that holds them."""

from traverse.lab.identification.report.page import (
    report_page,
    summary_lines,
    write_report,
)

__all__ = ["report_page", "summary_lines", "write_report"]
