"""Every command has exactly one method that carries it out."""

import pytest

from traverse.daemon.command_handlers import handlers_of, handles
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.commands.reload import ConfigurationReloader
from traverse.daemon.commands.resend import ResendCommands
from traverse.daemon.commands.scans import ScanCommands
from traverse.daemon.recorder.recorder import Recorder
from traverse.protocol.messages import COMMANDS, UndoArgs

OWNERS = (PointCommands, ScanCommands, ConfigurationReloader, ResendCommands, Recorder)


def test_all_commands_are_carried_out():
    owners = [owner.__new__(owner) for owner in OWNERS]
    handlers = handlers_of(*owners)
    assert handlers.keys() == COMMANDS.keys()
    assert handlers["undo"] == owners[0].undo


def test_a_command_without_a_method_or_with_two_is_refused():
    class Again:
        @handles(UndoArgs)
        async def take_back(self, args):
            return {}

    owners = [owner.__new__(owner) for owner in OWNERS]
    with pytest.raises(TypeError, match="two methods carry out the command 'undo'"):
        handlers_of(*owners, Again())
    with pytest.raises(TypeError, match="no method carries out: record"):
        handlers_of(*owners[:-1])
