"""What the thread of the outbox is asked, and what it tells of itself."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from traverse.daemon.config.schema import OutboxSection
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.records import Entry, Figures, StorageError


@dataclass(frozen=True, slots=True)
class Keep:
    """Keep a point; told with its number, or None where that failed.

    Attributes:
        generation: grows whenever points have failed.
    """

    generation: int
    entry: Entry


@dataclass(frozen=True, slots=True)
class Ask:
    """Do something with the database; told with the result, or the exception."""

    work: Callable[[MessageDatabase], Any]
    told: Callable[[Any], None]


@dataclass(frozen=True, slots=True)
class Rules:
    """What may be forgotten."""

    section: OutboxSection
    running: str


@dataclass(frozen=True, slots=True)
class Condition:
    """How the outbox is, as its thread sees it."""

    trouble: StorageError | None = None
    figures: Figures = Figures()  # noqa: RUF009 - a frozen value


Job = Keep | Ask | Rules
