"""Campaigns and arm files with everything that a verdict rests on."""

from pathlib import Path

from traverse.kinematics.arm_file.arm import read_arm, write_arm

HEAD = """\
operator = "M. Curie"
place = "Laboratory 2"
start_utc = 2026-11-20T09:00:00Z
[circumstances]
probe = "R-P21, ball of ruby"
humidity_percent = 45.0
warm_up_min = 90.0
"""
KINDS = {"ball_bar": "KB 0815", "sphere": "KS 25", "points": "L 1700", "plane": "E 100"}
CERTIFICATE = """\
certificate_number = "D-K-4711"
calibrated_by = "Example Laboratory, D-K-00000-01-00"
calibration_date = 2026-05-04
valid_until = 2028-05-04
material = "glass-ceramic"
"""
LIMITS = """\
schema = "traverse/acceptance-limits/1"
measuring_range_mm = 2400.0
[mpe]
{mpe}
[standards]
temperature_std_c = 0.1
form_mm = 0.0006
fixture_std_mm = 0.0003
"""


def state_all(campaign: Path) -> None:
    """Add what a laboratory states to a simulated campaign."""
    file = campaign / "campaign.toml"
    head, table, tail = file.read_text("utf-8").partition("\n[")
    text = f"{head}\n{HEAD}{table[1:]}{tail}"
    for kind, serial_number in KINDS.items():
        head = f'kind = "{kind}"\n'
        number = f'serial_number = "{serial_number}"\n'
        certificate = CERTIFICATE
        if kind == "plane":  # its form does not expand
            certificate = certificate.replace('material = "glass-ceramic"\n', "")
        text = text.replace(head, head + number + certificate)
    file.write_text(text, "utf-8")


def write_numbered(arm: Path, to: Path) -> Path:
    """Copy an arm file with a serial number."""
    write_arm(to, read_arm(arm).model_copy(update={"serial_number": "D7-0042"}))
    return to


def limits_text(**mpe: float) -> str:
    """Limits that state all that budgets need."""
    lines = [f"{key} = {value}" for key, value in mpe.items()]
    return LIMITS.format(mpe="\n".join(lines))
