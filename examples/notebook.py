"""Points of an arm in a notebook or script: take some, look at them."""

import sys

import numpy as np

from traverse import BlockingArm, CommandRefused

arm_name, broker = sys.argv[1], sys.argv[2]

with BlockingArm(arm_name, broker) as arm:
    arm.label("ball")
    try:
        captured = [arm.capture() for _ in range(3)]
    except CommandRefused as refused:
        sys.exit(f"{refused.text}: {refused.remedy}")
    xyz_mm = np.array([point.xyz_mm for point in captured])
    print("mean", xyz_mm.mean(axis=0).round(3), "mm")
    for point in arm.points(idle_timeout_s=1.0):  # until a second without a point
        print(point.seq, point.xyz_mm, point.quality.ok)
