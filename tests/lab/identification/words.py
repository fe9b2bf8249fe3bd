"""What an identification says, for tests."""

from traverse.lab.identification.report.page import WORDS
from traverse.lab.identification.results.outcome import outcome_of
from traverse.lab.identification.results.result import Identification


def said(result: Identification) -> str:
    """Reasons of its state, and its sigma0."""
    judged = outcome_of(result)
    lines = [*judged.outcome.sentences, *WORDS.lines("sigma0", result, judged)]
    return " ".join(lines)
