"""An arm file with the covariance of its links and axes beside it."""

import hashlib

import numpy as np

from tests.docs.pages import CHECKOUT
from traverse.kinematics.arm_file.arm import read_arm

DESIGN = CHECKOUT / "cli" / "demo_data" / "arm.toml"


def write_uncertain_arm(folder, links_mm, axes_rad):
    """Write the demo's arm with these standard deviations of every component."""
    joints = [joint.name for joint in read_arm(DESIGN).joints]
    parts = {"axis": axes_rad, "link": links_mm}
    stds = {
        f"{joint}.{part}.{c}": std
        for part, std in parts.items()
        for joint in joints
        for c in "xyz"
    }
    covariance = np.diag(np.square(list(stds.values())))
    file = folder / "arm.cov.npz"
    np.savez(file, names=list(stds), covariance=covariance)
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    text = DESIGN.read_text().partition("[identification]")[0]
    path = folder / "arm.toml"
    path.write_text(
        f'{text}\n[identification]\ncovariance_file = "arm.cov.npz"\n'
        f'covariance_digest = "sha256:{digest}"\n'
    )
    return path
