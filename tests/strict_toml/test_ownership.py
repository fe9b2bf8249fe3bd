"""Files of another user: whose, and what to do. As another user than root."""

import os
import sys
from pathlib import Path

import pytest

from tests.running import run_program
from traverse.strict_toml.ownership import refused_owner

NOBODY = 65534
SCRIPT = """
import os, sys
from pathlib import Path
from traverse.daemon.state_dir import state_folder, unusable
from traverse.daemon.store.recovery import storage_error_of
from traverse.strict_toml.ownership import refused_owner
from traverse.strict_toml.problems import FileError, toml_text
from sqlite3 import OperationalError, SQLITE_READONLY
folder = Path(sys.argv[1])
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
print(refused_owner(folder / "arm.toml"))
print(refused_owner(folder / "other" / "new.toml"))
print(refused_owner(folder / "closed" / "new.toml"))
print(refused_owner(folder / "mine.toml"))
print(repr(refused_owner(folder / "free.toml")))
try:
    toml_text(folder / "arm.toml")
except FileError as error:
    print(error.line)
try:
    state_folder(folder / "daemon.toml")
except OSError as error:
    print(unusable(error))
error = OperationalError("attempt to write a readonly database")
error.sqlite_errorcode = SQLITE_READONLY
trouble = storage_error_of(error, folder / "outbox.db")
print(f"{trouble.text} | {trouble.remedy}")
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="owners are set by root alone")
def test_a_file_of_another_user_is_refused_with_its_owner(tmp_path: Path) -> None:
    for folder in (tmp_path, *tmp_path.parents[:-2]):
        folder.chmod(0o755)
    for name, mode in (("arm.toml", 0o600), ("outbox.db", 0o644)):
        (tmp_path / name).touch(mode)
    (tmp_path / "outbox.db-wal").touch(0o600)
    for name, mode in (("mine.toml", 0o000), ("free.toml", 0o600)):
        (tmp_path / name).touch()
        (tmp_path / name).chmod(mode)
        os.chown(tmp_path / name, NOBODY, NOBODY)
    (tmp_path / "other").mkdir(mode=0o755)
    (tmp_path / "closed").mkdir(mode=0o700)
    os.chown(tmp_path / "closed", 1, 1)
    (tmp_path / "state").touch(0o600)
    environment = {**os.environ}
    environment.pop("STATE_DIRECTORY", None)
    ran = run_program(sys.executable, "-c", SCRIPT, tmp_path, env=environment)
    file, new, closed, mine, free, arm, state, outbox = ran.stdout.splitlines()
    me = "and this program runs as nobody"
    give = f"give it to nobody: chown nobody {tmp_path}"
    assert file == (
        f"{tmp_path}/arm.toml belongs to root (mode 0600), {me}; {give}/arm.toml"
    )
    assert new == f"{tmp_path}/other belongs to root (mode 0755), {me}; {give}/other"
    assert closed == (
        f"{tmp_path}/closed belongs to daemon (mode 0700), {me}; run it as daemon, or "
        f"{give}/closed"
    )
    assert mine.endswith(
        f"mine.toml has mode 0000, which its owner cannot use; chmod u+rwX {tmp_path}"
        "/mine.toml"
    )
    assert free == "''"
    assert arm.endswith(f"cannot be read: Permission denied: {file}")
    assert state.startswith("the state folder cannot be used: it, or a folder above")
    assert outbox == (
        f"the outbox {tmp_path}/outbox.db: {tmp_path}/outbox.db belongs to root (mode "
        f"0644), {me}: attempt to write a readonly database | {give}/outbox.db; the "
        "daemon continues as soon as it can write"
    )


def test_what_may_be_used_is_nobodys_fault(tmp_path: Path) -> None:
    assert refused_owner(tmp_path / "new" / "file") == ""
