"""The crash test's tap: what it follows is the board and nothing else."""

import io
import os
import threading
from pathlib import Path

from benchmarks.soak.tap import Mark, follow
from benchmarks.tools.rig import wait_for


def test_link_of_another_board_has_another_mark_though_it_leads_to_the_same(
    tmp_path: Path,
):
    link = tmp_path / "board.pty"
    assert Mark.of(link) is None
    link.symlink_to("/dev/pts/999")
    first = Mark.of(link)
    assert first is not None
    assert first.target == "/dev/pts/999"
    assert Mark.of(link) == first

    os.utime(link, ns=(1, 1), follow_symlinks=False)

    assert Mark.of(link) != first


def test_tap_lets_go_of_a_pty_that_is_not_the_board_any_more(tmp_path: Path):
    ours, line = os.openpty()  # of a stranger, who never hangs up
    link, host = tmp_path / "board.pty", tmp_path / "line.pty"
    link.symlink_to(os.ttyname(line))
    (tmp_path / "life").write_text("0")
    mark = Mark.of(link)
    assert mark is not None
    log = io.StringIO()
    tap = threading.Thread(target=follow, args=(link, mark, host, log), daemon=True)
    tap.start()
    wait_for(host.is_symlink, "a line for the daemon")

    fresh = tmp_path / "fresh"
    fresh.symlink_to(os.ttyname(line))
    os.utime(fresh, ns=(1, 1), follow_symlinks=False)
    fresh.replace(link)  # by the board, which is back

    tap.join(20.0)
    assert not tap.is_alive()
    assert not host.is_symlink()
    assert link.is_symlink()
    os.close(ours)
    os.close(line)
