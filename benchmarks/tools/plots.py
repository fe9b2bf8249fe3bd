"""`python -m benchmarks.tools.plots FOLDER`: pictures of docs/performance.md.

FOLDER holds files of the benchmarks: kinematics.json, path.json, presses.json,
press.json. The pictures are written beside them; `make figures` takes them into docs/.
"""

import json
from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.tools.command_line import run_main

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

OURS, THEIRS = "#1f6f8b", "#c8963e"
Tables = dict[str, dict[str, tuple[list[float], bool]]]


def tables(path: Path) -> Tables:
    """Read times [s] and owner by table and name from pyperf's file."""
    by_table: Tables = {}
    for benchmark in json.loads(path.read_text("utf-8"))["benchmarks"]:
        metadata = benchmark.get("metadata") or benchmark["runs"][0]["metadata"]
        values = [value for run in benchmark["runs"] for value in run["values"]]
        names = by_table.setdefault(metadata["table"], {})
        names[metadata["who"]] = values, bool(metadata["peer"])
    return by_table


def bars(axes: Axes, names: dict[str, tuple[list[float], bool]], title: str) -> None:
    """Medians in nanoseconds on a logarithmic scale, with their 10th to 90th parts."""
    entries = sorted(names.items(), key=lambda entry: -np.median(entry[1][0]))
    for place, (name, (times_s, is_peer)) in enumerate(entries):
        low, middle, high = np.percentile(times_s, (10, 50, 90)) * 1e9
        axes.barh(place, middle, color=THEIRS if is_peer else OURS)
        axes.plot((low, high), (place, place), color="black", linewidth=1)
        axes.text(high * 1.06, place, f"{middle:,.0f}", va="center", fontsize=8)
        axes.text(
            0.0,
            place,
            f"{name} ",
            ha="right",
            va="center",
            fontsize=8,
            transform=axes.get_yaxis_transform(),
        )
    axes.set_yticks([])
    axes.set_xscale("log")
    axes.set_xlim(right=axes.get_xlim()[1] * 3)
    axes.set_title(title, fontsize=9, loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


def stacked(
    by_table: Tables, path: Path, height: float, of: str, key: str = ""
) -> None:
    """Tables below each other: times of a pose, or of a sample."""
    figure, places = plt.subplots(
        len(by_table), 1, figsize=(7.5, height), layout="constrained"
    )
    for axes, (title, names) in zip(places, by_table.items(), strict=True):
        bars(axes, names, f"{title}: ns a {of}")
    if key:
        figure.suptitle(key, fontsize=9)
    figure.savefig(path, dpi=110)


def press_ratios(path: Path) -> dict[float, dict[str, list[float]]]:
    """Return ratios of Traverse's times to the plain script's, by rate and figure."""
    figures: dict[float, dict[str, dict[str, list[float]]]] = {}
    for turn in json.loads(path.read_text("utf-8"))["turns"]:
        of_rate = figures.setdefault(turn["rate_hz"], {})
        values = {"CPU a point": turn["cpu_us"], **turn["latency"]}
        for key, name in (
            ("CPU a point", "CPU a point"),
            ("p50_us", "p50"),
            ("p99_us", "p99"),
        ):
            programs = of_rate.setdefault(name, {})
            programs.setdefault(turn["program"], []).append(values[key])
    return {
        rate_hz: {
            name: np.divide(programs["Traverse"], programs["plain script"]).tolist()
            for name, programs in names.items()
        }
        for rate_hz, names in figures.items()
    }


def presses(by_rate: dict[float, dict[str, list[float]]], path: Path) -> None:
    """Times the plain script, round by round."""
    figure, places = plt.subplots(
        1, len(by_rate), figsize=(7.5, 3.2), layout="constrained", sharey=True
    )
    for axes, (rate_hz, names) in zip(
        np.atleast_1d(places), by_rate.items(), strict=True
    ):
        for place, values in enumerate(names.values()):
            axes.plot(np.full(len(values), place), values, "o", color=OURS)
        axes.axhline(1.0, color=THEIRS)
        axes.set_xticks(range(len(names)), names, fontsize=7)
        axes.set_title(f"{rate_hz:.0f} presses a second", fontsize=8, loc="left")
        axes.set_yscale("log")
        axes.spines[["top", "right"]].set_visible(False)
    np.atleast_1d(places)[0].set_ylabel("times the plain script", fontsize=8)
    figure.savefig(path, dpi=110)


def press(stages_of: dict[str, list[dict[str, float]]], path: Path) -> None:
    """Stages of one press, one after the other; medians of the rounds' medians."""
    figure, axes = plt.subplots(figsize=(7.5, 2.6), layout="constrained")
    names = [name for name in stages_of["stages"][0] if name != "whole"]
    begun_us = 0.0
    for place, name in enumerate(names):
        took_us = float(np.median([stage[name] for stage in stages_of["stages"]]))
        axes.barh(-place, took_us, left=begun_us, color=OURS)
        begun_us += took_us
        axes.text(begun_us + 10, -place, f"{took_us:.0f}", va="center", fontsize=8)
    axes.set_yticks(-np.arange(len(names)), names, fontsize=8)
    axes.set_xlabel("us since the last byte on the line", fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)


def main(folder: Path) -> None:
    key = "blue: Traverse; ochre: others; lines: 10 to 90 %"
    poses, samples = tables(folder / "kinematics.json"), tables(folder / "path.json")
    stacked(poses, folder / "performance-kernel.png", 9.5, "pose", key)
    stacked(samples, folder / "performance-path.png", 8.0, "sample")
    ratios = press_ratios(folder / "presses.json")
    presses(ratios, folder / "performance-presses.png")
    stages_of_one = json.loads((folder / "press.json").read_text("utf-8"))
    press(stages_of_one, folder / "performance-press.png")


if __name__ == "__main__":
    run_main(main)
