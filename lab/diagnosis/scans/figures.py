"""What became of a dense scan, in words and figures."""

import math
from typing import Any

from traverse.lab.diagnosis.scans.harmonics import HarmonicFinding
from traverse.lab.diagnosis.scans.scan_diagnosis import StreamDiagnosis

SCHEMA = "traverse/stream-diagnosis/1"
_LOG_10 = math.log(10.0)
_N_TOLD = 10


def stream_lines(result: StreamDiagnosis) -> list[str]:
    """Tell of the stream in lines for people."""
    thinning = result.thinning
    kept = len(thinning.poses)
    lasting = [one for one in thinning.lasting_s if math.isfinite(one)]
    lines = [
        f"{thinning.n_samples} samples at {thinning.rate_hz:.4g} Hz, noise lasts "
        f"{1e3 * max(lasting):.3g} ms at most: {kept} of them are tested as poses"
    ]
    if thinning.is_capped:
        lines.append(
            "More samples than that are independent; the rest only counts "
            "for the harmonics."
        )
    if result.harmonics:
        one = result.harmonics[0]
        lines.append(
            f"Largest harmonic that is left in all samples: {one.candidate.name}, "
            f"{1e6 * _size(one):.2g} ± {1e6 * one.std_rad:.2g} µrad."
        )
    return lines


def stream_json(result: StreamDiagnosis) -> dict[str, Any]:
    """Put what is special of a stream into plain values."""
    thinning, artefacts = result.thinning, result.diagnosis.campaign.artefacts
    return {
        "schema": SCHEMA,
        "samples": thinning.n_samples,
        "rate_hz": round(thinning.rate_hz, 6),
        "poses": len(thinning.poses),
        "artefacts": {
            artefact.id: {
                "noise_lasts_s": round(lasting, 9),
                "poses_apart_s": round(apart, 9),
            }
            for artefact, lasting, apart in zip(
                artefacts, thinning.lasting_s, thinning.apart_s, strict=True
            )
            if math.isfinite(lasting)
        },
        "terms_from_all_samples": result.n_from_stream,
        "harmonics": [
            {
                "kind": one.candidate.kind,
                "joint": one.candidate.joint,
                "order": one.candidate.order,
                "cos_rad": one.amplitudes_rad[0],
                "sin_rad": one.amplitudes_rad[1],
                "std_rad": one.std_rad,
                "log10_p": one.log_p / _LOG_10,
            }
            for one in result.harmonics[:_N_TOLD]
        ],
    }


def _size(one: HarmonicFinding) -> float:
    cos_rad, sin_rad = one.amplitudes_rad
    return math.hypot(cos_rad, sin_rad)
