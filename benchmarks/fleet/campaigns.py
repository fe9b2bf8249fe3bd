"""Campaigns an hour: one process, one a core, and a Dask cluster of as many workers.

python -m benchmarks.fleet.campaigns [--rounds N]

In turns, the same simulated campaigns of 240 poses: identified, and diagnosed, with all
files. Starting processes counts; the cluster is there before.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from distributed import LocalCluster

from benchmarks.fleet.family import SPREAD, design_of, poses_of
from traverse.fleet.campaigns import Request, run_campaigns
from traverse.fleet.workers import Workers
from traverse.kinematics.arm_file.arm import write_arm
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.identification.identify import Options
from traverse.simulator.campaigns import draw_noise, write_campaign

N_CAMPAIGNS, N_POSES = 8, 240


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet.campaigns")
    parser.add_argument("--rounds", type=int, default=3)
    chosen = parser.parse_args(arguments)
    n_cores = os.cpu_count() or 1
    with (
        tempfile.TemporaryDirectory() as folder,
        LocalCluster(
            n_workers=n_cores, threads_per_worker=1, dashboard_address=None
        ) as cluster,
    ):
        base = Path(folder)
        write_arm(base / "design.toml", design_of())
        campaigns = [base / f"bench-{seed}" for seed in range(N_CAMPAIGNS)]
        for seed, campaign in enumerate(campaigns):
            measured = draw_noise(poses_of(seed, N_POSES, SPREAD), seed)
            write_campaign(campaign, measured, design_of())
        ways = {
            "one process": Workers(1),
            f"{n_cores} processes": Workers(n_cores),
            f"Dask, {n_cores} workers": Workers(scheduler=cluster.scheduler_address),
        }
        print("| | campaigns an hour, median | least to most |\n|---|---|---|")
        for command, options in (
            ("identify", Options()),
            ("diagnose", DiagnosisOptions()),
        ):
            rates: dict[str, list[float]] = {name: [] for name in ways}
            for number in range(chosen.rounds):
                for name, workers in ways.items():
                    out = base / f"{command}-{number}-{len(rates[name])}-{name}"
                    request = Request(base / "design.toml", None, (), options, out)
                    begun_s = time.monotonic()
                    outcomes = list(run_campaigns(campaigns, request, workers))
                    hours = (time.monotonic() - begun_s) / 3600.0
                    if any(outcome.failed for outcome in outcomes):
                        raise RuntimeError(outcomes)
                    rates[name].append(N_CAMPAIGNS / hours)
            for name, values in rates.items():
                print(
                    f"| {command}, {name} | {statistics.median(values):.0f} | "
                    f"{min(values):.0f} to {max(values):.0f} |",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
