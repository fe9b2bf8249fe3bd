"""Measure the circle of six holes as a client of I++ DME: arguments [PORT [HOST]]."""

import re
import socket
import sys

import numpy as np

CENTRE_MM = np.array([600.0, 0.0, 60.0])  # nominal, from the drawing
DIAMETER_MM = 200.0
N_HOLES = 6


class Server:
    """One command at a time, with the answers of each."""

    def __init__(self, host: str, port: int) -> None:
        self._lines = socket.create_connection((host, port)).makefile("rw", newline="")
        self._tag = 0

    def ask(self, method: str) -> list[str]:
        """Send a command and wait until it is done; return its data."""
        self._tag += 1
        tag, data = f"{self._tag:05d}", []
        self._lines.write(f"{tag} {method}\r\n")
        self._lines.flush()
        for line in self._lines:
            if line.startswith(f"{tag} %"):
                return data
            if " ! Error(0," in line or " ! Error(1," in line:
                print(line.strip())  # a warning: the command goes on
            elif " ! " in line:
                raise SystemExit(line.strip())
            elif line.startswith(f"{tag} #"):
                data.append(line[8:].strip())
        raise SystemExit("the server has closed the connection")


def numbers(data: str) -> np.ndarray:
    return np.array([float(text) for text in re.findall(r"\(([-+.\deE]+)\)", data)])


def main(port: str = "1294", host: str = "localhost") -> None:
    server = Server(host, int(port))
    server.ask("StartSession()")
    (tool,) = server.ask("GetProp(Tool.Name(),Tool.AvrRadius())")
    print(tool)
    server.ask("OnPtMeasReport(X(),Y(),Z())")
    points = []
    for i in range(N_HOLES):
        angle = 2.0 * np.pi * i / N_HOLES
        x, y, z = CENTRE_MM + DIAMETER_MM / 2.0 * np.array(
            [np.cos(angle), np.sin(angle), 0.0]
        )
        print(f"touch hole {i + 1} at {x:.0f} {y:.0f} {z:.0f} mm", flush=True)
        (data,) = server.ask(f"PtMeas(X({x:.4f}),Y({y:.4f}),Z({z:.4f}),IJK(0,0,1))")
        points.append(numbers(data))
    server.ask("EndSession()")
    x, y, z = np.array(points).T
    # |p - c|^2 = r^2 is linear in the centre c and in r^2 - |c|^2.
    rows = np.column_stack([2.0 * x, 2.0 * y, np.ones(N_HOLES)])
    (cx, cy, rest), *_ = np.linalg.lstsq(rows, x**2 + y**2, rcond=None)
    radius = np.sqrt(rest + cx**2 + cy**2)
    form = np.ptp(np.hypot(x - cx, y - cy))
    print(f"centre {cx:.2f} {cy:.2f} mm")
    print(f"diameter {2.0 * radius:.2f} mm, form {form:.2f} mm")


main(*sys.argv[1:])
