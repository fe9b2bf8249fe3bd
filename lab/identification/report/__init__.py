"""The report of an identification: words, pictures and one page that holds them."""

from traverse.lab.identification.report.page import report_page, write_report
from traverse.lab.identification.report.words import summary_lines

__all__ = ["report_page", "summary_lines", "write_report"]
