"""Files for Telegraf and Grafana: their queries against a real store."""

import json
import re
import time
import tomllib

import pytest

from tests.docs.pages import CHECKOUT
from tests.fleet.test_overview import GOOD, health, history, store_messages
from tests.fleet.test_store import EVENT, point
from traverse.fleet.evidence import add_evidence
from traverse.fleet.opening import open_database
from traverse.fleet.tables import migrate

FOLDER = CHECKOUT / "docs" / "integrations"


@pytest.mark.needs("postgresql")
def test_every_panel_of_the_dashboard_shows_what_the_store_has(postgres_url, tmp_path):
    opened = open_database(postgres_url)
    migrate(opened)
    now_ns = time.time_ns()
    messages = (
        GOOD.model_copy(update={"time_ns": now_ns}),
        health(time_ns=now_ns),
        point(0, time_ns=now_ns, temperature_c=20.5),
        EVENT.model_copy(
            update={"severity": "error", "first_ns": now_ns, "last_ns": now_ns}
        ),
    )
    store_messages(opened, tmp_path, *(("a", message) for message in messages))
    history(tmp_path / "i.db", "a", 3)
    add_evidence(opened, tmp_path / "i.db")
    with opened.transaction() as run:
        run("INSERT INTO lost VALUES ('a', 's', '', 0, 3, 1, 'gone')")
    panels = json.loads((FOLDER / "grafana.json").read_text())["panels"]
    assert len(panels) >= 7
    for panel in panels:
        (target,) = panel["targets"]
        # As Grafana writes its macro for the last day.
        statement = re.sub(
            r"\$__unixEpochNanoFilter\((\w+)\)",
            rf"\1 >= {now_ns - 86_400 * 10**9} AND \1 <= {now_ns}",
            target["rawSql"],
        )
        assert "$__" not in statement
        with opened.transaction() as run:
            rows = run(statement)
        assert rows, panel["title"]
        if panel["title"] == "Arms":
            assert rows[0][:2] == ("a", "ready")
    opened.close()


def test_telegraf_reads_the_port_of_the_metrics():
    values = tomllib.loads((FOLDER / "telegraf.conf").read_text())
    (source,) = values["inputs"]["prometheus"]
    assert all(url.endswith(":9464/metrics") for url in source["urls"])
    assert "9464" in (CHECKOUT / "docs" / "reference" / "metrics.md").read_text()
    (target,) = values["outputs"]["postgresql"]
    assert "password" not in target["connection"]
