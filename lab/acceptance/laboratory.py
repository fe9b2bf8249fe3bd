"""The TOML file of a laboratory: who certifies, for whom, under which number."""

from datetime import date
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import StrictModel

# What says that somebody has not said it yet.
_NOTHING = frozenset(("n/a", "none", "not stated", "tbd", "todo", "unknown"))


def says_nothing(value: object) -> bool:
    """Return whether a text, or another value, states nothing."""
    if not isinstance(value, str):
        return value is None
    return not any(map(str.isalnum, value)) or value.strip().casefold() in _NOTHING


def _stating(text: str) -> str:
    if says_nothing(text):
        raise ValueError(f"{text!r} states nothing; leave the line out, or say it")
    return text


Text = Annotated[
    str,
    Field(pattern=r"^\S+(\s+\S+)*$", max_length=500),
    AfterValidator(_stating),
]
CountryCode = Annotated[str, Field(pattern="^[A-Z]{2}$")]


class Contact(StrictModel):
    """A laboratory or a customer, with its address.

    Attributes:
        code: Of the accreditation, of a laboratory.
        country: Two capital letters, ISO 3166-1.
    """

    name: Text
    code: Text | None = None
    email: Text | None = None
    phone: Text | None = None
    street: Text | None = None
    post_code: Text | None = None
    city: Text
    country: CountryCode


class Person(StrictModel):
    """A person who answers for the certificate."""

    name: Text
    role: Text | None = None
    main_signer: bool = False


class Item(StrictModel):
    """Statements about the arm that its file does not have."""

    manufacturer: Text | None = None
    model: Text | None = None
    serial_number: Text | None = None


class Laboratory(StrictModel):
    """Statements of a certificate that do not follow from what was measured.

    Attributes:
        number: Of the certificate, never used twice.
        issued: Date of issue; None: the day on which it is made.
        performed_at: Where it was measured, in the words of the DCC.
        replaces: Number of the certificate that this one substitutes.
    """

    schema_: Literal["traverse/laboratory/1"] = Field(alias="schema")
    number: Text
    issued: date | None = None
    performed_at: Literal[
        "laboratory", "customer", "laboratoryBranch", "customerBranch", "other"
    ] = "laboratory"
    replaces: Text | None = None
    laboratory: Contact
    customer: Contact
    persons: tuple[Person, ...] = Field(min_length=1)
    arm: Item = Item()

    @property
    def plain_values(self) -> dict[str, Any]:
        """What is stated, for JSON."""
        return self.model_dump(mode="json", exclude_none=True, exclude={"schema_"})


def refuse_early_issue(issued: date | None, measured_to_utc: str | None) -> None:
    """Refuse a date of issue before the last touch.

    Raises:
        FileError: It is.
    """
    if issued is not None and issued.isoformat() < (measured_to_utc or "")[:10]:
        message = f"is {issued}, before the last touch on {measured_to_utc}"
        raise FileError("laboratory.toml", f"issued {message}; give the day of issue")
