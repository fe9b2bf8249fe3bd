"""Names of joints for an arm file, from other programs' names."""

import re
import unicodedata
from collections.abc import Mapping, Sequence

from traverse.kinematics.arm_file.checks import is_joint_name
from traverse.strict_toml.problems import shown, unknown_name_message


def names_for_arm(
    names: Sequence[str], renames: Mapping[str, str]
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Map names of joints to names for an arm file.

    A name that an arm file may have stays. Of others letters lose their accents, any
    other characters become `_`; what is left of no letter is J1, J2, ... by its place.
    A number is added where the name is taken.

    Args:
        names: n of them; equal ones stay equal, which the arm file refuses.
        renames: New names by old ones, which go before.

    Returns:
        The names, (n,), and new ones by old ones of those that differ.

    Raises:
        ValueError: `renames` has an unknown name, or an invalid new one.
    """
    for old, new in renames.items():
        if old not in names:
            raise ValueError(unknown_name_message("joint", old, names))
        if not is_joint_name(new):
            raise ValueError(
                f"{shown(new)} is not a joint name; use letters, digits, '-' and '_'"
            )
    kept = {name: renames.get(name, name) for name in names}
    new_names = {old: new for old, new in kept.items() if is_joint_name(new)}
    used_names = set(new_names.values())
    for position, name in enumerate(names, 1):
        if name in new_names:
            continue
        plain = _plain(name) or f"J{position}"
        new, number = plain, 1
        while new in used_names:
            number += 1
            new = f"{plain}_{number}"
        used_names.add(new)
        new_names[name] = new
    changed = {old: new for old, new in new_names.items() if old != new}
    return tuple(new_names[name] for name in names), changed


def _plain(name: str) -> str:
    letters = unicodedata.normalize("NFKD", name)
    bare = "".join(letter for letter in letters if not unicodedata.combining(letter))
    plain = re.sub(r"[^A-Za-z0-9-]+", "_", bare).strip("_-")
    return plain if re.search(r"[A-Za-z0-9]", plain) else ""
