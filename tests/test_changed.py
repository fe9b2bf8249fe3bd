"""Which tests `make check` selects, in a checkout of a few files."""

import subprocess
from pathlib import Path

import pytest

from tests.changed import changed_files, selected

FILES = {
    "store/__init__.py": "",
    "store/outbox.py": "SIZE = 1\n",
    "store/queue.py": "from root.store.outbox import SIZE\n",
    "page/view.js": "",
    "tests/store/helper.py": "import root.store.queue\n",
    "tests/store/test_outbox_limits.py": "",
    "tests/store/outbox/test_whole.py": "",
    "tests/store/test_near.py": "from root.store import outbox\n",
    "tests/store/test_helped.py": "from tests.store.helper import root\n",
    "tests/store/test_unplain.py": "from store.queue import SIZE\n",
    "tests/page/test_outbox_shown.py": "",
    "tests/page/test_view.py": 'SCRIPT = "view.js"\n',
}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Committed files, their folders linked below an import root."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    (tmp_path / "src" / "root").mkdir(parents=True)
    (tmp_path / "src" / "root" / "store").symlink_to("../../store")
    author = ("-c", "user.name=a", "-c", "user.email=a@b.c")
    for words in (
        ("init", "-q", "-b", "main"),
        ("add", "."),
        (*author, "commit", "-qm", "1"),
    ):
        subprocess.run(["git", "-C", tmp_path, *words], check=True)
    return tmp_path


def test_nothing_is_selected_where_nothing_changed(checkout: Path) -> None:
    assert selected(checkout, changed_files(checkout)) == []


def test_tests_of_a_module_are_those_named_like_it_and_those_that_import_it(
    checkout: Path,
) -> None:
    (checkout / "store" / "outbox.py").write_text("SIZE = 2\n")
    assert changed_files(checkout) == {"store/outbox.py"}
    assert selected(checkout, {"store/outbox.py"}) == [
        "tests/store/outbox/test_whole.py",
        "tests/store/test_outbox_limits.py",
        "tests/store/test_near.py",
        "tests/store/test_unplain.py",
        "tests/store/test_helped.py",
    ]


def test_changed_and_new_tests_come_first(checkout: Path) -> None:
    (checkout / "tests" / "store" / "test_new.py").write_text("")
    (checkout / "store" / "queue.py").write_text("")
    chosen = selected(checkout, changed_files(checkout))
    assert chosen == [
        "tests/store/test_new.py",
        "tests/store/test_unplain.py",
        "tests/store/test_helped.py",
    ]


def test_what_is_no_module_is_tested_where_it_is_named(checkout: Path) -> None:
    (checkout / "page" / "view.js").write_text("let x;")
    assert selected(checkout, changed_files(checkout)) == ["tests/page/test_view.py"]


def test_a_branch_has_all_that_it_changed_since_main(checkout: Path) -> None:
    git = ("git", "-C", str(checkout), "-c", "user.name=a", "-c", "user.email=a@b.c")
    subprocess.run([*git, "checkout", "-qb", "other"], check=True)
    (checkout / "store" / "queue.py").write_text("")
    subprocess.run([*git, "commit", "-qam", "2"], check=True)
    assert changed_files(checkout) == {"store/queue.py"}
