"""The report of a diagnosis: words, pictures and one page that holds them."""

from traverse.lab.diagnosis.report.page import report_page, summary_lines
from traverse.lab.diagnosis.report.pictures import Plots, plots_of

__all__ = ["Plots", "plots_of", "report_page", "summary_lines"]
