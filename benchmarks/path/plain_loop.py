"""The measuring path as a first try: frame by frame.

`cobs`, `struct`, numpy on one pose and `json`. pyserial and paho are left out, since
the path beside it has no port and no broker either.
"""

import json
import struct
from binascii import crc_hqx

import numpy as np
from cobs import cobs

from traverse.daemon.pose.arm_model import ArmModel

_BODY = struct.Struct("<BBBBII7I7B")


class PlainLoop:
    """The loop, ready for one arm of seven joints."""

    def __init__(self, model: ArmModel) -> None:
        self._model = model
        self._counts_per_turn = model.encoders.counts_per_turn
        self._to_rad = model.encoders.signs * 2.0 * np.pi / self._counts_per_turn
        self._last = model.encoders.zeros_rad / self._to_rad

    def run(self, data: bytes) -> list[str]:
        texts = []
        for segment in data.split(b"\0"):
            if not segment:
                continue
            content = cobs.decode(segment)
            body, crc = content[:-2], int.from_bytes(content[-2:], "little")
            if crc_hqx(body, 0xFFFF) != crc:
                continue
            _, _, _, _, seq, ticks, *fields = _BODY.unpack(body)
            turn = self._counts_per_turn
            counts = np.array(fields[:7])
            counts = counts + np.round((self._last - counts) / turn) * turn
            self._last = counts
            angles_rad = counts * self._to_rad
            pose = self._pose(angles_rad)
            texts.append(
                json.dumps(
                    {
                        "seq": seq,
                        "time_s": ticks * 1e-6,
                        "xyz_mm": pose[:3, 3].tolist(),
                        "ijk": (pose[:3, :3] @ self._shank).tolist(),
                        "angles_rad": angles_rad.tolist(),
                        "counts": counts.tolist(),
                        "status": fields[7:],
                    }
                )
            )
        return texts

    @property
    def _shank(self) -> np.ndarray:
        return self._model.geometry.probe_direction

    def _pose(self, angles_rad: np.ndarray) -> np.ndarray:
        geometry = self._model.geometry
        pose = np.eye(4)
        pose[:3, 3] = geometry.origin_mm
        links_mm = geometry.links_mm.copy()
        links_mm[-1] += geometry.probe_vector_mm
        turns_rad = angles_rad - geometry.zeros_rad
        for axis, link_mm, turn_rad in zip(
            geometry.axes, links_mm, turns_rad, strict=True
        ):
            x, y, z = axis
            skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            step = np.eye(4)
            step[:3, :3] += np.sin(turn_rad) * skew
            step[:3, :3] += (1.0 - np.cos(turn_rad)) * skew @ skew
            step[:3, 3] = step[:3, :3] @ link_mm
            pose = pose @ step
        return pose
