"""Refuse commands that arrive too late.

The sender of a command waits some seconds for it. If the daemon, the broker or the
network stands still, it arrives later, when another person may be handling the arm.

Strategy: the UTC of two computers is not compared. The daemon publishes its clock twice
a second. A sender that reads it states in `expires` until when, by that clock, the
command may begin. The sender counts from the message's arrival, so that delays either
way shorten the validity.

For commands without `expires` the daemon subscribes to its own clock. A broker keeps
the order: a command that arrives after a clock message reached the broker after that
message was sent. The time since then bounds how long the command waited at the broker,
on the network or unread in this process. After a standstill, old commands arrive within
moments and look new; for that time all without `expires` are refused.
"""

import uuid
from dataclasses import dataclass

from traverse.daemon.clock import HostClock
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.mqtt.subscriber import IncomingCommand
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Clock, Expiry
from traverse.protocol.topics import clock_topic

EXPIRED = "command.expired"
VALID_S = 5.0
"""Validity of a command whose sender states none."""
STANDSTILL_S = 2.0
SETTLING_S = 1.0
PERIOD_S = 0.5
KEPT_S = 10
"""Oldest clock message that a broker keeps."""
REMEDY = "send it as a new request, if it is still wanted"


@dataclass(frozen=True, slots=True)
class Arrival:
    """Evidence on how old a command is.

    Attributes:
        since_ns: the broker did not have it before.
        is_clock_returned: the broker returns messages of the clock.
        standstill_s: length of a standstill that has just ended; else 0.
        valid_s: validity that the broker enforces.
    """

    since_ns: int
    is_clock_returned: bool
    standstill_s: float
    valid_s: float


class CommandExpiry:
    """Publishes the clock, follows its messages, and judges commands by it."""

    def __init__(self, arm: str, clock: HostClock) -> None:
        self.topic = clock_topic(arm)
        self._arm = arm
        self._clock = clock
        self._name = uuid.uuid4().hex
        self._subscribed_ns = 0
        self._since_ns = 0
        self._settled_ns = 0
        self._standstill_s = 0.0

    def message(self) -> Clock:
        return Clock(arm=self._arm, clock=self._name, now_ns=self._clock.elapsed_ns())

    def receive(self, incoming: IncomingCommand) -> None:
        """Take a message of this arm's clock, mostly our own."""
        try:
            message = decode(Clock, incoming.payload)
        except MessageError:
            return  # unknown version or malformed
        now_ns = self._clock.elapsed_ns()
        is_current = self._since_ns < message.now_ns <= now_ns
        if incoming.retained or message.clock != self._name or not is_current:
            return
        stood_s = (now_ns - self._since_ns) * 1e-9
        if self._since_ns and stood_s > STANDSTILL_S:
            self._standstill_s = stood_s
            self._settled_ns = now_ns + round(SETTLING_S * 1e9)
        self._since_ns = message.now_ns

    def arrival(self, incoming: IncomingCommand) -> Arrival:
        """Collect the evidence on a command; call on receipt."""
        expiry_s = incoming.expiry_s
        is_settled = self._clock.elapsed_ns() >= self._settled_ns
        return Arrival(
            max(self._since_ns, incoming.subscribed_ns),
            self._since_ns >= incoming.subscribed_ns,
            0.0 if is_settled else self._standstill_s,
            VALID_S if expiry_s is None else float(expiry_s),
        )

    def check(self, expires: Expiry | None, arrival: Arrival) -> None:
        """Check that a command may begin now.

        Raises:
            RequestRefusedError: it is late, or that cannot be excluded.
        """
        if expires is None:
            self._check_arrival(arrival)
        elif expires.clock != self._name:
            raise RequestRefusedError(
                EXPIRED,
                "the command was sent to an earlier run of this daemon, whose clock "
                f"its `expires` names ({expires.clock[:64]})",
                f"{REMEDY}, by the clock on {self.topic}",
            )
        elif (late_ns := self._clock.elapsed_ns() - expires.at_ns) > 0:
            raise RequestRefusedError(
                EXPIRED,
                f"the command came {late_ns * 1e-9:.1f} s after the instant until "
                "which its sender wanted it; it was not executed",
                REMEDY,
            )

    def _check_arrival(self, arrival: Arrival) -> None:
        age_s = (self._clock.elapsed_ns() - arrival.since_ns) * 1e-9
        if arrival.standstill_s:
            raise RequestRefusedError(
                EXPIRED,
                "this daemon, the broker or the network between them stood still for "
                f"{arrival.standstill_s:.1f} s until just now; the command may be from "
                "before, and was not executed",
                f"{REMEDY}; state `expires` in it to have it judged by itself",
            )
        if age_s <= arrival.valid_s:
            return
        if arrival.is_clock_returned:
            raise RequestRefusedError(
                EXPIRED,
                f"the command may have waited {age_s:.1f} s on its way here; it was "
                f"valid for {arrival.valid_s:g} s, and was not executed",
                REMEDY,
            )
        raise RequestRefusedError(
            EXPIRED,
            f"the broker does not return this daemon's messages on {self.topic}, so "
            "nothing tells how long the command was on its way; it was not executed",
            f"allow the daemon's account to read and write {self.topic} in the access "
            "list of the broker, as deploy/mosquitto/acl does",
        )
