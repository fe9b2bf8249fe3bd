"""Command lines as they were written before, and what they are now.

Kept for one release: an old form does what the new one does, and standard error has a
sentence with the new one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class OldForms:
    """Old forms of the arguments of one command.

    Attributes:
        options: New names of options.
        positional: Options whose value is an argument now.
        words: Options that are a word now.
    """

    options: Mapping[str, str] = field(default_factory=dict)
    positional: tuple[str, ...] = ()
    words: Mapping[str, str] = field(default_factory=dict)


_NAME_OF_ARM = OldForms(options={"--arm": "--arm-name"})
_CONFIG = OldForms(positional=("--config", "-c"))
OLD_FORMS: Mapping[str, OldForms] = {
    **dict.fromkeys(
        (
            *("point", "undo", "label", "session", "reload", "home", "confirm"),
            *("watch", "page", "record", "points resend", "probe use"),
            *(f"gateway {to}" for to in ("ippdme", "keys", "live", "lines")),
            "gateway home-assistant",
        ),
        _NAME_OF_ARM,
    ),
    "scan": OldForms(
        options=_NAME_OF_ARM.options, words={"--start": "start", "--stop": "stop"}
    ),
    "run": _CONFIG,
    "check": _CONFIG,
    "simulate devices": _CONFIG,
}
"""By the words behind `traverse`."""


def as_now(words: str, arguments: Sequence[str]) -> list[str]:
    """Write the arguments of a command in their new form; the same where they are."""
    forms = OLD_FORMS.get(words)
    if forms is None:
        return list(arguments)
    new: list[str] = []
    rest = iter(arguments)
    for argument in rest:
        if argument == "--":
            return [*new, argument, *rest]
        name, equals, value = argument.partition("=")
        if name in forms.options:
            new.append(f"{forms.options[name]}{equals}{value}")
        elif name in forms.positional:
            # What lacks its value lacks an argument then.
            new += (
                [value]
                if equals
                else [following for following in [next(rest, None)] if following]
            )
        elif argument in forms.words:
            new.append(forms.words[argument])
        else:
            new.append(argument)
    return new


def commands_as_now(words: str, arguments: Sequence[str]) -> list[str]:
    """Write the arguments of a group of commands in their new form."""
    first = next(iter(arguments), "")
    if words == "simulate" and first.partition("=")[0] in _CONFIG.positional:
        return ["devices", *as_now("simulate devices", arguments)]
    return list(arguments)


def sentence(words: str, old: Sequence[str], new: Sequence[str]) -> str:
    """Say how a command line is written now."""
    before, now = (" ".join(("traverse", words, *given)) for given in (old, new))
    return f"{before}: is written `{now}` from this release on"
