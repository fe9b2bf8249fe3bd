"""`python -m benchmarks.soak.witness ARM HOST PORT STORE [quiet]`: a foreign consumer.

It shares no code with Traverse: paho, msgpack and the pages of the documentation. It
commands points unless it is quiet, keeps every message byte for byte before it
acknowledges it, and requests missing ones. `faults` compares that with the outbox in
the end, which it reads with sqlite3 alone.
"""

import argparse
import hashlib
import json
import sqlite3
import threading
import time
import uuid
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import msgpack
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

POINT_S, LOOK_S = 0.5, 2.0
PATIENCE_S = 60.0  # of a reader with a witness that begins anew, and recovers its store
TABLES = """
CREATE TABLE IF NOT EXISTS arrivals (n INTEGER PRIMARY KEY AUTOINCREMENT,
    session TEXT, seq INTEGER, id TEXT, digest TEXT);
CREATE TABLE IF NOT EXISTS commanded (request TEXT PRIMARY KEY);
CREATE TABLE IF NOT EXISTS promised (id TEXT PRIMARY KEY);
"""


class Witness:
    """Follows one arm over MQTT 5, for ever.

    Args:
        store: SQLite file of received and promised messages.
    """

    def __init__(self, arm: str, store: Path) -> None:
        self._arm = arm
        self._lock = threading.Lock()
        self._database = sqlite3.connect(store, check_same_thread=False)
        self._database.executescript(TABLES)
        self._client = Client(
            CallbackAPIVersion.VERSION2,
            client_id=f"witness-of-{arm}",
            protocol=MQTTProtocolVersion.MQTTv5,
            manual_ack=True,
        )
        self._client.on_connect = self._on_connect
        self._client.on_message = self._on_message
        self._client.reconnect_delay_set(1, 1)

    def run(self, host: str, port: int, *, is_quiet: bool) -> None:
        """Connect repeatedly; command points, request missing ones."""
        keeping = Properties(PacketTypes.CONNECT)
        keeping.SessionExpiryInterval = 3600
        self._client.connect_async(
            host, port, keepalive=5, clean_start=False, properties=keeping
        )
        self._client.loop_start()
        looked_s = 0.0
        while True:
            time.sleep(POINT_S)
            if not is_quiet:
                request = self._command("point", {})
                self._write("INSERT INTO commanded VALUES (?)", (request,))
            if time.monotonic() - looked_s > LOOK_S:
                looked_s = time.monotonic()
                self._command("resend", {})  # answered with all sessions

    def _on_connect(self, client: Client, *details: object) -> None:
        del details
        root = f"traverse/{self._arm}"
        client.subscribe([(f"{root}/point", 1), (f"{root}/reply/+", 0)])

    def _on_message(
        self, client: Client, userdata: object, message: MQTTMessage
    ) -> None:
        del userdata
        values = read(message.payload)
        if message.topic == f"traverse/{self._arm}/point":
            digest = hashlib.sha256(message.payload).hexdigest()
            row = (values["session"], values["seq"], values["id"], digest)
            self._write("INSERT INTO arrivals VALUES (NULL, ?, ?, ?, ?)", row)
            client.ack(message.mid, message.qos)  # only now: it is kept
        elif values.get("ok") and message.topic.endswith("/reply/point"):
            promised = (values["result"]["id"],)
            self._write("INSERT OR IGNORE INTO promised VALUES (?)", promised)
        elif values.get("ok") and "sessions" in (values.get("result") or {}):
            for stored in values["result"]["sessions"]:
                for first, last in self._gaps(stored):
                    ends = {"from_seq": first, "to_seq": last}
                    self._command("resend", {"session": stored["session"], **ends})

    def _gaps(self, session: dict[str, Any]) -> Iterator[tuple[int, int]]:
        """Yield the first missing range of a session; the next one another time."""
        with self._lock:
            rows = self._database.execute(
                "SELECT DISTINCT seq FROM arrivals WHERE session = ?",
                (session["session"],),
            ).fetchall()
        has = {seq for (seq,) in rows}
        numbers = range(session["first_seq"], session["last_seq"] + 1)
        missing = [seq for seq in numbers if seq not in has]
        if missing:
            yield missing[0], missing[-1]

    def _command(self, name: str, args: dict[str, Any]) -> str:
        request = uuid.uuid4().hex
        command = {"schema": "traverse/command/1", "request": request, "args": args}
        self._client.publish(f"traverse/{self._arm}/cmd/{name}", json.dumps(command), 0)
        return request

    def _write(self, statement: str, values: tuple[Any, ...]) -> None:
        with self._lock, self._database as database:
            database.execute(statement, values)


def read(payload: bytes | bytearray) -> dict[str, Any]:
    """Decode a message in either encoding; only JSON begins with a brace."""
    values = json.loads(payload) if payload[:1] == b"{" else msgpack.unpackb(payload)
    return dict(values)


def seen(store: Path) -> tuple[int, int]:
    """Return how many points it has, and how many it has commanded."""
    with closing(sqlite3.connect(store, PATIENCE_S)) as database:
        (points,) = database.execute(
            "SELECT count(DISTINCT id) FROM arrivals"
        ).fetchone()
        (commanded,) = database.execute("SELECT count(*) FROM commanded").fetchone()
    return int(points), int(commanded)


def faults(store: Path, outbox: Path) -> tuple[dict[str, int], list[str]]:
    """Return figures and failures: acknowledged points lost, doubled, altered."""
    with closing(sqlite3.connect(store, PATIENCE_S)) as database:
        arrived = database.execute("SELECT session, seq, id, digest FROM arrivals")
        digests: dict[str, set[str]] = defaultdict(set)
        places: dict[str, set[tuple[str, int]]] = defaultdict(set)
        n_arrived = 0
        for session, seq, name, digest in arrived:
            digests[name].add(digest)
            places[name].add((session, seq))
            n_arrived += 1
        promised = {name for (name,) in database.execute("SELECT id FROM promised")}
    with closing(sqlite3.connect(f"file:{outbox}?mode=ro", uri=True)) as database:
        kept = database.execute(
            "SELECT session, seq, id, payload FROM messages ORDER BY number"
        ).fetchall()
    original = {name: hashlib.sha256(data).hexdigest() for _, _, name, data in kept}
    order = defaultdict(list)
    for session, seq, _, _ in kept:
        order[session].append(seq)
    kinds = {
        "promised, but never arrived": promised - digests.keys(),
        "in the outbox, but never arrived": original.keys() - digests.keys(),
        "arrived, but not in the outbox": digests.keys() - original.keys(),
        "arrived with several contents": {n for n, d in digests.items() if len(d) > 1},
        "arrived other than it is kept": {
            name
            for name, fingerprint in digests.items()
            if fingerprint != {original.get(name)}
        },
        "arrived under several numbers": {n for n, p in places.items() if len(p) > 1},
        "sessions whose numbers are not 0, 1, 2 ...": {
            session for session, seqs in order.items() if seqs != [*range(len(seqs))]
        },
    }
    complaints = [f"{len(v)} {k}: {sorted(v)[:3]}" for k, v in kinds.items() if v]
    if not promised:
        complaints.append("nothing was promised to the witness: it has seen nothing")
    figures = {
        "witness: promised": len(promised),
        "witness: messages": n_arrived,
        "witness: points": len(digests),
    }
    return figures, [f"witness: {text}" for text in complaints]


def main(arm: str, host: str, port: int, store: Path, quiet: str = "") -> None:
    Witness(arm, store).run(host, port, is_quiet=bool(quiet))


if __name__ == "__main__":
    # It shares no code with what it judges, nor with what judges by it.
    parser = argparse.ArgumentParser(description=__doc__)
    for name, kind in (("arm", str), ("host", str), ("port", int), ("store", Path)):
        parser.add_argument(name, type=kind)
    parser.add_argument("quiet", nargs="?", default="")
    main(**vars(parser.parse_args()))
