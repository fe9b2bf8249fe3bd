import re
from pathlib import Path

import pytest
import typer.main

from tests.running import invoke
from traverse.cli.__main__ import app


def commands(group, *words):
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, *words, name)
        else:
            yield " ".join((*words, name)), command


ALL = dict(commands(typer.main.get_command(app)))


def test_options_of_one_name_are_alike() -> None:
    for words, command in ALL.items():
        options = [p for p in command.params if p.param_type_name == "option"]
        for option in options:
            name, *short = option.opts
            if name == "--out":
                assert short == ["-o"], words
            if name == "--config":
                assert short == ["-c"], words
            if name == "--arm":
                assert "file" in option.help.lower() or "folder" in option.help, words
            if name == "--arm-name":
                assert "file" not in option.help.lower(), words


def test_run_takes_its_configuration_behind_config_too() -> None:
    run = ALL["run"]
    for words in ("d.toml", "--config d.toml", "-c d.toml", "--config=d.toml"):
        context = run.make_context("run", [*words.split(), "--keep-trying"])
        assert context.params["config"] == Path("d.toml"), words
        assert context.params["keep_trying"], words


@pytest.mark.parametrize(
    "words",
    [
        ("identify", "NOTHERE"),
        ("identify", "--compare", "NOTHERE", "NOTHERE"),
        ("diagnose", "NOTHERE", "--arm", "arm.toml"),
        ("predict", "NOTHERE", "--arm", "arm.toml"),
        ("verify", "NOTHERE"),
        ("certify", "NOTHERE", "--laboratory", "l.toml"),
        ("align", "NOTHERE", "--nominal", "n.toml"),
        ("simulate", "campaign", "NOTHERE", "--out", "o"),
        ("simulate", "scan", "NOTHERE", "--out", "o"),
    ],
)
def test_what_is_not_there_is_said_before_anything_else(words: tuple[str, ...]) -> None:
    output = invoke(*words, status=2).stderr
    assert (
        "NOTHERE: cannot be read: No such file or directory; check the path" in output
    )


def test_help_shows_the_help_of_a_command() -> None:
    for words in ((), ("arm", "show"), ("identify",)):
        shown = invoke("help", *words).stdout
        ours = invoke(*words, "--help").stdout
        bare = [re.sub(r"-h, |--help +", "", text).split() for text in (shown, ours)]
        assert bare[0] == bare[1], words
    assert (
        "there is no command 'nonsense'" in invoke("help", "nonsense", status=2).stderr
    )


def test_a_campaign_is_collected_into_another_folder(tmp_path: Path) -> None:
    template, out = tmp_path / "template", tmp_path / "monday"
    template.mkdir()
    text = 'schema = "traverse/campaign/1"\nposes = "poses.csv"\n'
    text += '[[artefacts]]\nid = "seat"\nkind = "cone"\n'
    (template / "campaign.toml").write_text(text, "utf-8")
    arm = Path(__file__).parents[2] / "cli/demo_data/arm.toml"
    words = ("collect", template, "--arm", arm, "-o", out, "--broker", "127.0.0.1:9")
    invoke(*words, status=None)  # which has no terminal here
    assert (out / "campaign.toml").read_text("utf-8") == text
    assert list(template.iterdir()) == [template / "campaign.toml"]
    assert "seat (cone)" in invoke(*words, status=None).output  # it continues
    (template / "campaign.toml").write_text(text + "# changed\n", "utf-8")
    assert "name another folder" in invoke(*words, status=2).stderr
