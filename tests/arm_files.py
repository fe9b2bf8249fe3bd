from collections.abc import Sequence

Encoder = tuple[int, int, str]  # counts a turn, sign, source


def joint_text(
    name: str,
    axis: Sequence[float],
    link_mm: Sequence[float],
    zero_rad: float = 0.0,
    encoder: Encoder | None = None,
    *,
    more: str = "",
) -> str:
    text = f'[[joints]]\nname = "{name}"\naxis = {list(axis)}\n'
    text += f"link_mm = {list(link_mm)}\nzero_rad = {zero_rad}\n{more}"
    if encoder is not None:
        counts, sign, source = encoder
        text += f"[joints.encoder]\ncounts_per_turn = {counts}\nsign = {sign}\n"
        text += f'source = "{source}"\n'
    return text


def arm_text(
    name: str,
    *joints: str,
    origin_mm: Sequence[float] = (0.0, 0.0, 0.0),
    probe: str = 'radius_mm = 3.0\nkind = "hard"',
    gravity_m_s2: float = 9.80665,
) -> str:
    parts = (
        f'schema = "traverse/arm/1"\nname = "{name}"\norigin_mm = {list(origin_mm)}\n',
        *joints,
        f"[probe]\n{probe}\n",
        "[reference]\ntemperature_c = 20.0\n"
        f"gravity_m_s2 = [0.0, 0.0, -{gravity_m_s2}]\n",
    )
    return "\n".join(parts)
