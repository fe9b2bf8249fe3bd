"""Many campaigns at once: by processes and a real Dask cluster, while workers die."""

import json
import os
import re
import socket
import subprocess
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from benchmarks.proofs.conditions import demo_arm
from tests.fleet.calls import killed_at_three, killed_once, squared
from tests.lab.identification.test_prior import measured
from tests.running import invoke
from traverse.fleet.campaigns import Request, run_campaigns
from traverse.fleet.workers import WorkerDiedError, Workers, WorkersError
from traverse.kinematics.arm_file.arm import write_arm
from traverse.lab.identification.identify import Options
from traverse.simulator.campaigns import write_campaign
from traverse.strict_toml.files import locked_folder

PATIENCE_S = 60.0
WHEN = datetime(2026, 11, 24, 12, tzinfo=UTC)
N_CAMPAIGNS = 3


def test_each_is_called_once():
    made = dict(Workers(processes=2).each(squared, range(20)))
    assert made == {number: number * number for number in range(20)}
    assert list(Workers(processes=1).each(squared, [])) == []


@pytest.mark.slow
def test_what_kills_workers_is_told_apart_from_the_rest():
    made = dict(Workers(processes=2).each(killed_at_three, range(8)))
    assert isinstance(made.pop(3), WorkerDiedError)
    assert made == {number: number for number in range(8) if number != 3}


@pytest.mark.slow
def test_what_a_dead_worker_had_is_done_again(tmp_path):
    files = [tmp_path / name for name in ("a", "once-1", "b", "once-2", "c")]
    made = dict(Workers(processes=2).each(killed_once, files))
    assert made == {file: file.name for file in files}


@pytest.mark.parametrize(
    "address", ["nonsense", "http://a:1", "tcp://a", "tcp://a b:1"]
)
def test_what_is_no_address_is_refused(address):
    with pytest.raises(WorkersError, match="no address of a Dask scheduler"):
        list(Workers(scheduler=address).each(squared, [1]))


def test_a_scheduler_that_is_not_there_is_refused(monkeypatch):
    monkeypatch.setattr("traverse.fleet.workers._CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as occupied:
        port = occupied.getsockname()[1]
    with pytest.raises(WorkersError, match="no Dask scheduler there"):
        list(Workers(scheduler=f"tcp://127.0.0.1:{port}").each(squared, [1]))


def test_a_folder_of_results_belongs_to_one_program(tmp_path):
    request = Request(tmp_path, None, (), Options(), tmp_path / "out", None)
    with (
        locked_folder(tmp_path, ""),
        pytest.raises(OSError, match="another program writes its results into it"),
    ):
        list(run_campaigns([], replace(request, out=tmp_path), Workers(processes=1)))
    assert list(run_campaigns([], request, Workers(processes=1))) == []


class Cluster:
    def __init__(self, folder):
        self._folder, self._logs = folder, []
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        options = ("--host", "127.0.0.1", "--port", str(port), "--no-show")
        self.scheduler = self._started("scheduler", *options, "--no-dashboard")
        until_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", port)).close()
                break
            except OSError:
                assert time.monotonic() < until_s, "no scheduler"
                time.sleep(0.1)
        # Without a nanny a dead worker stays dead.
        self.workers = [
            self._started(
                *("worker", self.address, "--nthreads", "1", "--no-nanny"),
                *("--no-dashboard", "--local-directory", str(folder / f"worker-{n}")),
            )
            for n in range(2)
        ]

    def _started(self, *words):
        log = (self._folder / f"log-{len(self._logs)}").open("w")
        self._logs.append(log)
        program = Path(sys.executable).with_name("dask")
        return subprocess.Popen(
            [str(program), *words],
            stdout=log,
            stderr=log,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        )

    def stop(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()
        for log in self._logs:
            log.close()


@pytest.fixture
def cluster(tmp_path):
    made = Cluster(tmp_path)
    yield made
    made.stop()


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaigns")
    write_arm(folder / "design.toml", demo_arm())
    for seed in range(N_CAMPAIGNS):
        write_campaign(folder / f"bench-{seed}", measured(seed, 48), demo_arm())
    return folder


def results(campaigns, out, workers):
    request = Request(
        *(campaigns / "design.toml", None, (), Options(), out), *("C. Gauss", WHEN)
    )
    folders = sorted(campaigns.glob("bench-*"))
    outcomes = []
    for outcome in run_campaigns(folders, request, workers):
        outcomes.append(outcome)
        yield outcome
    assert sorted(ended.name for ended in outcomes) == [ended.name for ended in folders]


def files_of(out):
    return {
        str(path.relative_to(out)): re.sub(rb"[0-9.]+ s\b", b"", path.read_bytes())
        for path in sorted(out.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def serial(campaigns, tmp_path_factory):
    out = tmp_path_factory.mktemp("serial")
    for outcome in results(campaigns, out, Workers(1)):
        assert (outcome.failed, outcome.good) == (False, True), outcome.verdict
    files = files_of(out)
    assert len(files) >= 4 * N_CAMPAIGNS
    return files


@pytest.mark.slow
def test_results_are_the_same_byte_by_byte_by_two_processes(
    campaigns, serial, tmp_path
):
    assert len(list(results(campaigns, tmp_path, Workers(2)))) == N_CAMPAIGNS
    assert files_of(tmp_path) == serial


@pytest.mark.slow
def test_results_are_the_same_byte_by_byte_by_a_cluster_that_loses_a_worker(
    campaigns, serial, tmp_path, cluster
):
    out = tmp_path / "distributed"
    by_cluster = Workers(scheduler=cluster.address)
    for number, _ in enumerate(results(campaigns, out, by_cluster)):
        if number == 0:
            cluster.workers[0].kill()
    assert files_of(out) == serial


@pytest.mark.slow
def test_a_scheduler_that_goes_away_ends_the_work_in_a_sentence(campaigns, tmp_path):
    cluster = Cluster(tmp_path)
    words = ["--arm", str(campaigns / "design.toml"), "--out", str(tmp_path / "out")]
    command = subprocess.Popen(
        [sys.executable, "-m", "traverse", "fleet", "identify"]
        + [str(path) for path in sorted(campaigns.glob("bench-*"))]
        + [*words, "--scheduler", cluster.address],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        output = command.stderr.readline()
        assert f"1 of {N_CAMPAIGNS}: bench-" in output
        cluster.stop()
        _, rest = command.communicate(timeout=PATIENCE_S)
    finally:
        command.kill()
        cluster.stop()
    assert command.returncode == 2
    assert "the Dask scheduler went away; what was done stays" in rest
    assert "Traceback" not in rest
    done = sorted((tmp_path / "out").iterdir())
    assert 1 <= len(done) < N_CAMPAIGNS
    for folder in done:  # whole, or not at all
        assert (folder / "SHA256SUMS").is_file()


@pytest.mark.slow
def test_the_command_goes_on_where_it_ended(campaigns, tmp_path):
    broken = campaigns.parent / f"{tmp_path.name}-broken"
    broken.mkdir()
    folder = str(campaigns / "bench-0")
    words = ["--arm", str(campaigns / "design.toml"), "--out", str(tmp_path / "out")]

    def run(*options, status=0):
        arguments = ["fleet", "identify", *options, *words, "--processes", "1"]
        return invoke(*arguments, status=status)

    ran = run(folder, str(broken), status=1)
    assert "1 campaign done, 1 failed" in ran.output
    assert "campaign.toml" in ran.output
    ran = run(folder, str(broken), status=2)
    assert "run those that have no results yet: --rest" in ran.output
    # What failed has no results: it is the rest.
    ran = run(folder, str(broken), "--rest", "--json", status=1)
    (repeated,) = json.loads(ran.stdout)["campaigns"]
    assert (repeated["name"], repeated["failed"]) == (broken.name, True)
    run(folder, folder, "--rest")
    twice = str(tmp_path / "bench-0")
    Path(twice).mkdir()
    words[3] = str(tmp_path / "other")
    ran = run(folder, twice, status=2)
    assert "2 campaigns are called bench-0" in ran.output


@pytest.mark.slow
def test_a_diagnosis_is_told_as_json(campaigns, tmp_path):
    arguments = [str(campaigns / "bench-2"), "--arm", str(campaigns / "design.toml")]
    out = ["--out", str(tmp_path / "found"), "--processes", "1", "--json"]
    ran = invoke("fleet", "diagnose", *arguments, *out)
    (campaign,) = json.loads(ran.stdout)["campaigns"]
    assert campaign == {"name": "bench-2", "failed": False, "verdict": "clean"}
