"""Differences between figures that are stated and figures that were computed again."""

from collections.abc import Iterator, Mapping

from traverse.strict_toml.problems import shown

# A nanometre of a metre, and what processors differ by.
_RELATIVE, _ABSOLUTE = 1e-6, 1e-9


def differences(stated: object, again: object, where: str = "") -> Iterator[str]:
    """Name every value that differs, by its path; numbers but for rounding."""
    if isinstance(stated, Mapping) and isinstance(again, Mapping):
        for key in dict.fromkeys([*stated, *again]):
            inner = f"{where}.{key}" if where else str(key)
            if key not in stated or key not in again:
                yield f"{inner}: only the {'data' if key in again else 'result'} has it"
            else:
                yield from differences(stated[key], again[key], inner)
    elif isinstance(stated, list | tuple) and isinstance(again, list | tuple):
        if len(stated) != len(again):
            yield f"{where}: the data give {len(again)}, the result has {len(stated)}"
            return
        for at, (one, other) in enumerate(zip(stated, again, strict=True)):
            name = one.get("name", at) if isinstance(one, Mapping) else at
            yield from differences(one, other, f"{where}[{name}]")
    elif not _agree(stated, again):
        told = f"the data give {shown(again)}, the result states {shown(stated)}"
        yield f"{where}: {told}"


def _agree(stated: object, again: object) -> bool:
    if isinstance(stated, bool) or isinstance(again, bool):
        return stated is again
    if isinstance(stated, int | float) and isinstance(again, int | float):
        return abs(stated - again) <= _ABSOLUTE + _RELATIVE * abs(again)
    return stated == again
