"""Numbers with their nouns and verbs, for printed text of every package."""

_SINGULAR = {"are": "is", "were": "was", "have": "has", "do": "does"}


def counted(count: float, noun: str, verb: str = "") -> str:
    """Write a number with its noun: `1 point waits`, `2 points wait`, `0 touches`.

    Args:
        count: of things.
        noun: in the singular; its end makes the plural.
        verb: in the plural, or nothing.
    """
    number = f"{count:g}" if isinstance(count, float) else str(count)
    if count == 1:
        verb_form = _SINGULAR.get(verb, f"{verb}s") if verb else ""
    else:
        is_soft = noun.endswith(("ch", "sh", "s", "x"))
        noun = f"{noun[:-1]}ies" if noun.endswith("ry") else noun + "es"[not is_soft :]
        verb_form = verb
    return f"{number} {noun} {verb_form}".rstrip()
