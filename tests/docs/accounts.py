"""Where each command that the documentation shows is run, or why it is not.

A page that a test runs from the page itself is in ``RUN``: what is added there is
run, too. Single commands are in ``ELSEWHERE``, with the test that runs the same, and
in ``NOT_RUN``, with the reason.
"""

import re
from typing import Final

RUN: Final = {
    "docs/tutorial/first-light.md": "tests/docs/test_first_light.py",
    "docs/tutorial/identify-an-arm.md": "tests/docs/test_identify_tutorial.py",
    "docs/tutorial/a-detective-story.md": "tests/docs/test_detective_story.py",
    "docs/how-to/connect-a-board.md": "tests/docs/test_bench_guides.py",
    "docs/how-to/read-points-in-your-program.md": "tests/docs/test_bench_guides.py",
    "docs/how-to/record-and-replay.md": "tests/docs/test_bench_guides.py",
    "docs/how-to/export-points.md": "tests/docs/test_bench_guides.py",
    "docs/how-to/points-as-lines.md": "tests/docs/test_bench_guides.py",
    "docs/how-to/measure-a-part.md": "tests/docs/test_operator_guides.py",
    "docs/how-to/change-a-probe.md": "tests/docs/test_operator_guides.py",
    "docs/how-to/arm-file-from-dh-or-urdf.md": "tests/docs/test_office_guides.py",
    "docs/how-to/secure-the-broker.md": "tests/docs/test_office_guides.py",
    "docs/how-to/campaign-from-a-table.md": "tests/cli/identify/test_table.py",
    "docs/how-to/extend-traverse.md": "tests/test_extensions.py",
    "docs/tutorial/circle-over-ippdme.md": "tests/docs/test_circle_tutorial.py",
    "docs/how-to/metrology-software.md": "tests/docs/test_bench_guides.py",
    "docs/tutorial/arduino-to-calibrated-arm.md": "tests/docs/test_arduino_tutorial.py",
    "docs/tutorial/old-microscribe.md": "tests/docs/test_old_microscribe.py",
    "docs/tutorial/parts-to-calibrated-arm.md": "tests/docs/test_parts_tutorial.py",
}
"""Pages of which a test runs every command but those named below."""
_MICROSCRIBE = "tests/docs/test_old_microscribe.py"
_VM = "deploy/vm/system.sh"
ELSEWHERE: Final = {
    r"traverse microscribe arm-file --port /dev/ttyUSB0 ": _MICROSCRIBE,
    r"traverse run traverse.toml --embedded-broker": _MICROSCRIBE,
    r"traverse diagnose ": "tests/cli/test_diagnose.py",
    r"traverse verify ": "tests/cli/test_verify.py",
    r"(traverse certify|openssl req) ": "tests/cli/test_certify.py",
    r"traverse points (key|verify) ": "tests/end_to_end/delivery/test_signed_points.py",
    r"traverse (arm to-qif|export \S+ --to qif) ": "tests/cli/arm/test_qif.py",
    r"traverse trace ": "tests/lab/certificates/test_trace.py",
    r"traverse check limits.toml": "tests/cli/test_check.py",
    r"traverse simulate scan ": ("tests/simulator/campaigns/test_poses.py"),
    r"traverse align ": "tests/cli/test_align.py",
    r"traverse daily-check ": "tests/cli/test_daily_check.py",
    r"traverse points (list|export) ": "tests/cli/points/test_points.py",
    r"traverse amt21 ": "tests/cli/devices/test_amt21.py",
    r"traverse can ": "tests/cli/devices/test_can.py",
    r"traverse check bad.toml": "tests/cli/test_check.py",
    r"traverse collect ": "tests/end_to_end/cli/test_collect.py",
    r"traverse gateway live ": "tests/cli/points/test_gateway.py",
    r"traverse gateway lines .*--template mtconnect": (
        "tests/client/gateways/test_lines.py"
    ),
    r"traverse gateway opcua ": "tests/cli/points/test_gateway.py",
    r"traverse gateway keys ": "tests/client/gateways/test_keys.py",
    r"traverse gateway home-assistant ": "tests/cli/points/test_gateway.py",
    r"traverse page ": "tests/browser/test_operator_page.py",
    r"traverse setup ": "tests/browser/test_setup_page.py",
    r"(traverse|make) demo": "tests/end_to_end/cli/test_demo.py",
    r"mosquitto_(sub|pub) -h broker.lab": "tests/end_to_end/delivery/test_tls.py",
    r"mosquitto_passwd ": "tests/deploy/test_mosquitto_configuration.py",
    r"sudo systemctl stop mosquitto; ": (
        "tests/end_to_end/delivery/test_broker_outages.py"
    ),
    r"sudo apt-get (install|remove|purge) ": _VM,
    r"make deb": _VM,
    r"traverse store ": "tests/fleet/test_chaos.py",
    r"traverse fleet (identify|diagnose) ": "tests/fleet/test_campaigns.py",
    r"traverse identify short .* --family ": "tests/lab/identification/test_prior.py",
    r"dask (scheduler|worker)": "tests/fleet/test_campaigns.py",
    r"traverse fleet family ": "tests/lab/identification/test_family.py",
    r"traverse fleet ": "tests/fleet/test_overview.py",
}
_ROOT = "changes a computer; `make test-vm` installs, starts, upgrades and removes"
NOT_RUN: Final = {
    r"(mkdir|CHECKOUT=|export PATH=)": "the reader's folder; tests have their own",
    r"ls -l /dev/serial/": "no adapter here",
    r"cat /sys/bus/usb-serial/": "no adapter here",
    r"(sudo|journalctl|systemctl|chown|cp deploy|install -m|ip -details) ": _ROOT,
    r"make test$": "runs this",
    r"python3 -m venv ~/traverse ": "the reader's folder",
    r"(pip install traverse_cmm|cp -r examples/|cd ~/ros2_ws|colcon |ros2 |\. inst)": (
        "needs ROS; the page says how it was tried"
    ),
    r"TRAVERSE_ARM=": "needs FreeCAD or Blender; the page says how it was tried",
    r"openssl rand ": "a random number",
}


def elsewhere(page: str, command: str) -> str | None:
    """The test that runs a page's command, other than from the page."""
    tests = (test for p, test in ELSEWHERE.items() if re.match(p, command))
    return next(tests, None) if page not in RUN else None


def why_not_run(command: str) -> str | None:
    """Why no test runs a command; None: one has to."""
    reasons = (reason for p, reason in NOT_RUN.items() if re.match(p, command))
    return next(reasons, None)
