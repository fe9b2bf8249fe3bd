"""Damaged files passed to every command that reads them: refused in words.

    python -m tests.fuzz.files --mutations 300        every command and file
    python -m tests.fuzz.files identify/poses --mutations 50 --seed 7

A run is a fork of a program that has the libraries loaded: at most `END_S` seconds of
work, 1 GB more memory than at its start, a documented exit status and no traceback.
Files that break that are kept in build/fuzz/files/.
"""

import argparse
import contextlib
import io
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from typer.testing import CliRunner

from benchmarks.tools.sizes import sized
from tests.fuzz.file_samples import make_samples
from traverse.cli.__main__ import app

KEPT = Path(__file__).parent.parent.parent / "build" / "fuzz" / "files"
END_S = 20
MEMORY_BYTES = 10**9
STATUSES = {0, 1, 2, 3}

# Nobody listens there.
NOBODY = "--broker 127.0.0.1:9"
# By command the files that are damaged; paths are relative to the samples.
_FILES: dict[str, dict[str, str]] = {
    "check arm.toml": {"check/arm": "arm.toml"},
    "check daemon.toml": {"check/daemon": "daemon.toml"},
    "check simulator.toml": {"check/simulator": "simulator.toml"},
    "check probes.toml": {"check/probes": "probes.toml"},
    "check limits.toml": {"check/limits": "limits.toml"},
    "check nominal.toml": {"check/nominal": "nominal.toml"},
    "check plan.toml": {"check/plan": "plan.toml"},
    "check campaign": {
        "check/campaign": "campaign/campaign.toml",
        "check/poses": "campaign/poses.csv",
    },
    "arm show arm.toml": {"arm-show/arm": "arm.toml"},
    "arm to-dh arm.toml": {"arm-to-dh/arm": "arm.toml"},
    "arm from-dh dh.csv --convention classic --out robot.toml": {
        "arm-from-dh/csv": "dh.csv"
    },
    "arm from-dh dh.toml --convention classic --out robot.toml": {
        "arm-from-dh/toml": "dh.toml"
    },
    "arm from-urdf robot.urdf --tip ball --out robot.toml": {
        "arm-from-urdf/urdf": "robot.urdf"
    },
    "identify campaign --arm arm.toml --out out": {
        "identify/arm": "arm.toml",
        "identify/campaign": "campaign/campaign.toml",
        "identify/poses": "campaign/poses.csv",
    },
    "predict campaign --arm arm.toml": {
        "predict/poses": "campaign/poses.csv",
        "predict/campaign": "campaign/campaign.toml",
    },
    "diagnose campaign --arm arm.toml --out out --max-terms 1": {
        "diagnose/poses": "campaign/poses.csv"
    },
    "verify accepted --standard asme-b89.4.22 --arm arm.toml": {
        "verify/campaign": "accepted/campaign.toml",
        "verify/poses": "accepted/poses.csv",
    },
    "verify accepted --standard asme-b89.4.22 --arm arm.toml --limits limits.toml": {
        "verify/limits": "limits.toml"
    },
    "verify --check certificate": {
        "verify-check/json": "certificate/certificate.json",
        "verify-check/data": "certificate/data/poses.csv",
    },
    "certify certificate --laboratory laboratory.toml": {
        "certify/json": "certificate/certificate.json",
        "certify/laboratory": "laboratory.toml",
    },
    "trace certificate": {"trace/certificate": "certificate/certificate.json"},
    "trace identified/arm.toml": {"trace/arm": "identified/arm.toml"},
    "trace campaign": {"trace/campaign": "campaign/campaign.toml"},
    "trace run.mcap": {"trace/recording": "run.mcap"},
    "trace points.jsonl": {"trace/points": "points.jsonl"},
    "points verify points.jsonl --key arm.key.pub": {
        "points-verify/points": "points.jsonl",
        "points-verify/key": "arm.key.pub",
    },
    "align measured.csv --nominal nominal.toml": {
        "align/nominal": "nominal.toml",
        "align/points": "measured.csv",
    },
    "align points.jsonl --nominal nominal.toml": {"align/lines": "points.jsonl"},
    "daily-check --arm arm.toml --history history.db --show": {
        "daily-check/history": "history.db"
    },
    "daily-check --arm arm.toml --history history.db --campaign check": {
        "daily-check/poses": "check/poses.csv"
    },
    "daily-check --arm arm.toml --history history.db --show --acceptance "
    "certificate/certificate.json": {
        "daily-check/certificate": "certificate/certificate.json"
    },
    "export outbox.db --out out.csv --force": {"export/outbox": "outbox.db"},
    "export points.jsonl --out out.csv --force": {"export/lines": "points.jsonl"},
    "export run.mcap --out out.csv --force": {"export/recording": "run.mcap"},
    "points list --db outbox.db": {"points-list/outbox": "outbox.db"},
    "points export --db outbox.db --out out.csv --force": {
        "points-export/outbox": "outbox.db"
    },
    "replay run.mcap": {"replay/recording": "run.mcap"},
    "verify run.mcap --standard asme-b89.4.22": {"verify/recording": "run.mcap"},
    "run daemon.toml": {"run/configuration": "daemon.toml", "run/arm": "arm.toml"},
    "replay steps.mcap": {"replay/steps": "steps.mcap"},
    "run identified.toml": {"run/covariance": "identified/arm.cov.npz"},
    "check identified.toml": {"check/covariance": "identified/arm.cov.npz"},
    "align campaign --nominal campaign --method leapfrog --arm identified/arm.toml": {
        "align/covariance": "identified/arm.cov.npz"
    },
    "verify accepted --standard asme-b89.4.22 --arm identified/arm.toml": {
        "verify/covariance": "identified/arm.cov.npz"
    },
    "fleet add history.db --database other.db": {"fleet-add/history": "history.db"},
    "fleet add certificate --database other.db": {
        "fleet-add/certificate": "certificate/certificate.json"
    },
    "fleet add history.db --database store.db": {"fleet-add/store": "store.db"},
    "fleet overview --database store.db": {"fleet-overview/store": "store.db"},
    "fleet family identified identified identified identified identified "
    "identified identified identified": {
        "fleet-family/result": "identified/identification.json"
    },
    f"store {NOBODY} --database store.db": {"store/database": "store.db"},
    f"collect campaign --arm arm.toml {NOBODY}": {
        "collect/arm": "arm.toml",
        "collect/campaign": "campaign/campaign.toml",
    },
    f"collect planned --arm arm.toml {NOBODY}": {"collect/plan": "planned/plan.toml"},
    f"collect collected --arm arm.toml {NOBODY}": {
        "collect/points": "collected/collected.jsonl"
    },
    "probe pivot campaign --arm arm.toml --cone cone-1": {
        "probe-pivot/poses": "campaign/poses.csv"
    },
    f"page {NOBODY} --token-file token": {"page/token": "token"},
    f"page {NOBODY} --certificate page.pem --key key.pem": {
        "page/certificate": "page.pem",
        "page/key": "key.pem",
    },
    "watch --broker mqtts://127.0.0.1:9 --client-certificate page.pem "
    "--client-key key.pem": {"watch/key": "key.pem"},
    "watch --broker mqtts://127.0.0.1:9 --ca-file page.pem": {
        "watch/authority": "page.pem"
    },
    f"watch {NOBODY} --username a --password-file token": {"watch/password": "token"},
    "simulate devices simulator.toml": {"simulate/configuration": "simulator.toml"},
}
# Name, the file that is damaged, the command.
COMMANDS = {
    name: (file, command)
    for command, files in _FILES.items()
    for name, file in files.items()
}
# They go on until they are ended where the file is good: that is no hang.
_ENDLESS = {"run", "simulate", "page", "store"}
_ENDLESS_S = 4
# On a busy machine so many seconds pass for one of work.
_BUSY = 6
_OF_COMPUTED = (
    "verify",
    "certify",
    "trace",
    "daily-check",
    "run/covariance",
    "check/covariance",
    "align/covariance",
    "fleet-",
    "store/",
    "collect/plan",
)

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_TOKENS = (
    *(b"1e308", b"-1e308", b"1e400", b"nan", b"inf", b"0", b"-1", b"1e-320"),
    *(b"9" * 30, b"9" * 5000, b'""', b'"\\u0000"', b"[]", b"{}", b"true", b"1_0"),
    *(b"[" * 500 + b"]" * 500, b"[" * 3000, b'"' + b"x" * 200_000 + b'"', b"\xff"),
    *(b"x" * 200_000, b"\0", b"/dev/zero", b'"/dev/zero"', b'"."', b'"a\nb"'),
)


@dataclass(frozen=True)
class Outcome:
    fault: str | None
    seconds: float
    grown_bytes: int


def mutated(content: bytes, chance: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 1, 2, 5))):
        place = chance.randrange(len(changed) + 1)
        numbers = list(_NUMBER.finditer(changed))
        lines = changed.split(b"\n")
        match chance.randrange(8):
            case 0 | 1 if numbers:
                start, end = chance.choice(numbers).span()
                changed[start:end] = chance.choice(_TOKENS)
            case 2:
                changed[place:place] = chance.choice(_TOKENS)
            case 3:
                del changed[place : place + chance.choice((1, 5, 100, 10_000))]
            case 4:
                changed[place:place] = changed[place : place + 500]
            case 5 if len(lines) > 1:
                line = chance.randrange(len(lines))
                lines[line : line + 1] = chance.choice(([], [lines[line]] * 2))
                changed = bytearray(b"\n".join(lines))
            case 6:
                del changed[place:]
            case _:
                for _ in range(chance.choice((1, 3, 30))):
                    if changed:
                        changed[chance.randrange(len(changed))] ^= (
                            1 << chance.randrange(8)
                        )
    return bytes(changed)


def mutated_inside(name: str, content: bytes, chance: random.Random) -> bytes:
    """Damage a container's contents, so that its checksums are right."""
    match Path(name).suffix:
        case ".mcap" if chance.random() < 0.7:
            return _mutated_recording(content, chance)
        case ".npz" if chance.random() < 0.7:
            return _mutated_arrays(content, chance)
        case _:
            return mutated(content, chance)


def _mutated_recording(content: bytes, chance: random.Random) -> bytes:
    reader = make_reader(io.BytesIO(content))
    messages = list(reader.iter_messages())
    attachments = list(reader.iter_attachments())
    metadata = list(reader.iter_metadata())
    header = reader.get_header()
    n_bad = min(chance.choice((1, 1, 3, 20)), len(messages))
    bad = chance.sample(range(len(messages)), n_bad)
    in_attachment = chance.random() < 0.2
    written = io.BytesIO()
    writer = Writer(written)
    writer.start(header.profile, header.library)
    for item in metadata:
        writer.add_metadata(item.name, item.metadata)
    for item in attachments:
        data = mutated(item.data, chance) if in_attachment else item.data
        writer.add_attachment(
            item.create_time, item.log_time, item.name, item.media_type, data
        )
    schemas, channels = {0: 0}, {}
    for number, (schema, channel, message) in enumerate(messages):
        if schema is not None and schema.id not in schemas:
            schemas[schema.id] = writer.register_schema(
                schema.name, schema.encoding, schema.data
            )
        if channel.id not in channels:
            channels[channel.id] = writer.register_channel(
                channel.topic,
                channel.message_encoding,
                schemas[channel.schema_id],
                channel.metadata,
            )
        data = message.data
        if number in bad and not in_attachment:
            data = mutated(data, chance)
        writer.add_message(
            channels[channel.id],
            message.log_time,
            data,
            message.publish_time,
            message.sequence,
        )
    writer.finish()
    return written.getvalue()


def _mutated_arrays(content: bytes, chance: random.Random) -> bytes:
    with np.load(io.BytesIO(content)) as file:
        arrays = {name: file[name] for name in file.files}
    name = chance.choice(list(arrays))
    values = arrays[name]
    place = chance.randrange(values.size)
    match chance.randrange(6):
        case 0:
            del arrays[name]
        case 1:
            arrays[name] = values[:place]
        case 2:
            arrays[name] = values[..., np.newaxis]
        case 3:
            arrays[name] = values.astype(chance.choice(("U3", "S2", "O")))
        case 4:
            arrays[name] = np.zeros((0,) * values.ndim, values.dtype)
        case _:
            changed = values.copy()
            if values.dtype.kind == "f":
                odd = chance.choice((np.nan, np.inf, -1.0, 1e308, 1e-320))
            else:
                odd = chance.choice(("", "nobody", "\0", "a\nb"))
            changed.reshape(-1)[place] = odd
            arrays[name] = changed
    written = io.BytesIO()
    np.savez(written, **arrays)
    return written.getvalue()


def replaced(path: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    yield "nothing", lambda: None
    yield "empty", path.touch
    yield "folder", path.mkdir
    yield "fifo", lambda: os.mkfifo(path)
    yield "endless", lambda: path.symlink_to("/dev/zero")
    yield "itself", lambda: path.symlink_to(path.name)

    def sparse() -> None:
        path.touch()
        os.truncate(path, 20 * 2**30)

    yield "sparse", sparse


def outcome(words: list[str], folder: Path) -> Outcome:
    log = folder / ".log"
    begun = time.monotonic()
    child = os.fork()
    if child == 0:
        _run(words, folder, log)
    limit_s = _ENDLESS_S if words[0] in _ENDLESS else _BUSY * END_S
    done = 0
    while not done and time.monotonic() - begun < limit_s:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if not done:
            time.sleep(0.005)
    seconds = time.monotonic() - begun
    if not done:
        os.kill(child, signal.SIGKILL)
        _, status, usage = os.wait4(child, 0)
    grown = usage.ru_maxrss * 1024 - _resident_bytes()
    fault = _fault(words, log, status if done else None)
    return Outcome(fault, seconds, grown)


def _resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def _fault(words: list[str], log: Path, status: int | None) -> str | None:
    """Return the fault in how a command ended; status None: it was ended."""
    log_text = log.read_text("utf-8", "replace")
    if "Traceback" in log_text:
        return f"traceback: {log_text.strip().splitlines()[-1][:200]}"
    if status is None:
        return None if words[0] in _ENDLESS else f"no end after {_BUSY * END_S} s"
    if status == signal.SIGXCPU:
        return f"no end after {END_S} s of work"
    code = os.waitstatus_to_exitcode(status)
    if code not in STATUSES:
        return f"exit status {code}: {log_text[-200:]}"
    if code in {2, 3} and not log_text.strip():
        return f"exit status {code} without a word"
    return None


def _run(words: list[str], folder: Path, log: Path) -> None:
    """The child: never returns."""
    code = 99
    try:
        os.setpgid(0, 0)
        os.chdir(folder)
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        nothing = os.open("/dev/null", os.O_RDONLY)
        for target in (0, 1, 2):
            os.dup2(nothing if target == 0 else descriptor, target)
        size = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        most = size * os.sysconf("SC_PAGE_SIZE") + MEMORY_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CPU, (END_S, END_S))
        sys.argv = ["traverse", *words]
        from traverse.cli.__main__ import main  # noqa: PLC0415

        try:
            main()
            code = 0
        except SystemExit as end:
            code = (
                end.code if isinstance(end.code, int) else 0 if end.code is None else 1
            )
    except BaseException:  # noqa: BLE001 - is what is looked for
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def fuzz(
    names: list[str], mutations: int, seed: int, samples: Path, kept: Path = KEPT
) -> Iterator[tuple[str, int, float, int, Counter[str]]]:
    """Damage files; return each command's runs, longest time, most memory, failures."""
    for name in names:
        file, line = COMMANDS[name]
        failures: Counter[str] = Counter()
        longest_s, most_bytes, runs = 0.0, 0, 0
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary) / "of"
            harms: list[tuple[str, Callable[[Path], object]]] = []
            content = (samples / file).read_bytes()
            for replacement, harm in replaced(folder / file):
                harms.append((replacement, lambda _, harm=harm: harm()))
            for number in range(mutations):
                chance = random.Random(f"{name} {seed} {number}")
                bad = mutated_inside(file, content, chance)
                harms.append((str(number), lambda p, bad=bad: p.write_bytes(bad)))
            for replacement, harm in harms:
                shutil.rmtree(folder, ignore_errors=True)
                shutil.copytree(samples, folder)
                (folder / file).unlink()
                harm(folder / file)
                ended = outcome(line.split(), folder)
                runs += 1
                longest_s = max(longest_s, ended.seconds)
                most_bytes = max(most_bytes, ended.grown_bytes)
                if ended.fault is not None:
                    kind = "" if replacement.isdigit() else replacement
                    failures[f"{kind} {ended.fault}".strip()] += 1
                    kept.mkdir(parents=True, exist_ok=True)
                    place = kept / f"{name.replace('/', '-')}-{seed}-{replacement}"
                    if (folder / file).is_file() and replacement.isdigit():
                        shutil.copyfile(folder / file, place)
                    shutil.copyfile(folder / ".log", f"{place}.log")
        yield name, runs, longest_s, most_bytes, failures


def load(samples: Path, names: list[str]) -> None:
    """Run commands once with good files: forks need not import what these did."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "warm"
        shutil.copytree(samples, folder)
        with contextlib.chdir(folder):
            for line in {COMMANDS[name][1] for name in names}:
                if line.split()[0] not in _ENDLESS:
                    CliRunner().invoke(app, line.split())


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.files")
    parser.add_argument("names", nargs="*", metavar="COMMAND/FILE")
    parser.add_argument("--mutations", type=int, default=sized(300, 1))
    parser.add_argument("--seed", type=int, default=1)
    expected = parser.parse_args()
    names = expected.names or sized(list(COMMANDS), ["check/daemon"])
    broken = total = 0
    with tempfile.TemporaryDirectory() as folder:
        samples = make_samples(
            Path(folder), computed=any(n.startswith(_OF_COMPUTED) for n in names)
        )
        load(samples, names)
        for name, runs, longest_s, most_bytes, failures in fuzz(
            names, expected.mutations, expected.seed, samples
        ):
            total += runs
            broken += failures.total()
            sys.stdout.write(f"{name:26} {runs:4} runs, at most {longest_s:5.1f} s ")
            sys.stdout.write(
                f"and {most_bytes / 1e6:4.0f} MB, {failures.total()} broke\n"
            )
            for fault, times in failures.most_common(8):
                sys.stdout.write(f"    {times:3} x {fault}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{total} runs, {broken} broke\n")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
