import stat

from traverse.daemon.state_dir import state_folder


def test_it_stands_beside_the_configuration_for_its_owner_alone(tmp_path, monkeypatch):
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    folder = state_folder(tmp_path / "daemon.toml")
    assert folder == tmp_path / "state"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert state_folder(tmp_path / "daemon.toml") == folder


def test_systemd_says_where_and_the_first_of_several_counts(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", f"{tmp_path}/a/b:{tmp_path}/c")
    assert state_folder(tmp_path / "daemon.toml") == tmp_path / "a" / "b"
    assert (tmp_path / "a" / "b").is_dir()
    assert not (tmp_path / "c").exists()
