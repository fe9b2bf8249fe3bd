"""Table of the conditions that a measured number rests on.

Each condition begins not established and must be established for each subject. Status,
metrics, reference pages and tests are made from this table.
"""

from dataclasses import dataclass
from typing import Literal

from traverse.protocol.messages.quality import QualityFlag

SubjectKind = Literal["device", "arm", "host"]
ARM, HOST = "arm", "host"
CONFIRM = "confirm (`traverse confirm`, or on the operator's page)"
HOME = "home it (`traverse home`, or on the operator's page)"


@dataclass(frozen=True, slots=True)
class Condition:
    """One row.

    Attributes:
        subject: each device, the arm, or the computer.
        means: what holds while it is established.
        established_by: event that establishes it.
        lost_by: event that ends it.
        flags: of numbers without it.
        marks: it marks every number while not established; otherwise only samples in
            which a detector finds it lost, and it recovers after a while without any.
        code: of the lasting event while it is lost.
        remedy: unless the loss states its own.
        command: MQTT command by which the operator establishes it; or empty.
        remembered: what is kept over a restart of the daemon; or empty.
    """

    name: str
    subject: SubjectKind
    means: str
    established_by: str
    lost_by: str
    flags: QualityFlag
    marks: Literal["all", "samples"]
    code: str
    remedy: str
    command: str = ""
    remembered: str = ""
    severity: Literal["warning", "error"] = "error"


CONDITIONS = (
    Condition(
        "present",
        "device",
        "the device is there, and is as the arm file describes it",
        "the device answers, and nothing of it contradicts the arm file",
        "the device is lost, or does not match the arm file",
        QualityFlag.INCOMPLETE,
        "all",
        "device.lost",
        "see the device's events",
    ),
    Condition(
        "readings",
        "arm",
        "readings of all joints are valid, complete and recent, without a warning",
        "samples in which nothing is missing",
        "a reading that is invalid, missing, late or repeated, an encoder's warning, "
        "bytes that were spoilt where no check sum tells, or no reading for a second",
        QualityFlag.ENCODER_ERROR
        | QualityFlag.ENCODER_WARNING
        | QualityFlag.LATE
        | QualityFlag.STALE
        | QualityFlag.INCOMPLETE,
        "samples",
        "condition.readings",
        "see the devices' events; check encoders and lines",
        severity="warning",
    ),
    Condition(
        "channels",
        "arm",
        "no encoder repeats one count while its joint moves",
        "counts that vary with their joints",
        "a joint that stops without braking, or whose noise ends, so that its count is "
        "exactly constant while other joints move",
        QualityFlag.STALE,
        "all",
        "condition.channels",
        "turn the joint: if its angle follows, it was at rest; else check the encoder "
        "and its wires, and take the points since then again",
    ),
    Condition(
        "single_readings",
        "device",
        "each reading of an encoder is a new one",
        "readings that follow the motion of their joints, for 20 s of motion after one "
        "that did not",
        "two readings within 30 s, or one that no hand could make, that repeat exactly "
        "the count before while their joint moves on, as the next one shows: a read of "
        "the encoder that failed",
        QualityFlag.STALE,
        "all",
        "condition.single_readings",
        "where the read of an encoder failed let the firmware print `x` or no line, or "
        "set the status of the latch board's channel; check the encoder's wires; read "
        "an encoder that has a cycle of its own less often. Then lead the joint for "
        "20 s, and take the points since then again",
    ),
    Condition(
        "identity",
        "device",
        "the device has the serial numbers that were confirmed, in the same order",
        "`reference`, once for a device; a device without serial numbers has none to "
        "confirm",
        "another device answers, or its encoders have changed places",
        QualityFlag.IDENTITY_UNCONFIRMED,
        "all",
        "condition.identity",
        f"if the devices are the right ones, touch a point that you know, then "
        f"{CONFIRM}; else put the confirmed ones back",
        command="reference",
        remembered="the serial numbers that were confirmed",
    ),
    Condition(
        "reference",
        "device",
        "place and turns of the joints that the device reads are known",
        "`reference`, or `home` for incremental encoders, after each loss of power; "
        "an absolute encoder needs it once; one without a serial number of its own "
        "after each start and each loss of its port, unless `assumed_devices` names "
        "its device",
        "the device has been without power, has other firmware or another home, was "
        "confirmed with another arm's file, one of its counts has jumped, or a joint "
        "may have turned unseen",
        QualityFlag.TURNS_UNCERTAIN,
        "all",
        "device.turns_uncertain",
        f"bring the arm to its reference, touch a point that you know, then {CONFIRM}",
        command="reference",
        remembered="the power-up that was confirmed, and what homing adds to readings",
    ),
    Condition(
        "device_clock",
        "device",
        "the device's clock is tied to the computer's, with a stated bound",
        "readings from which the relation of the two clocks is learned",
        "a clock that restarts, steps or stands still, or too large a bound",
        QualityFlag.TIME_UNCERTAIN,
        "samples",
        "condition.device_clock",
        "wait some seconds; if it stays, see the device's events",
        severity="warning",
    ),
    Condition(
        "skew",
        "arm",
        "all joints are known at one instant, within skew_limit_mm",
        "samples whose joints were read close enough together for the motion",
        "a motion too fast for joints that are read at different instants",
        QualityFlag.SKEW,
        "samples",
        "condition.skew",
        "move slower, read the devices faster, or set skew_limit_mm to what is enough",
        severity="warning",
    ),
    Condition(
        "geometry",
        "arm",
        "the arm's geometry has been identified, with a covariance",
        "an arm file of an identification that has its covariance file; probes of a "
        "library state theirs",
        "an arm file without, or changed since; a probe whose covariance is not stated",
        QualityFlag.GEOMETRY_UNKNOWN,
        "all",
        "condition.geometry",
        "identify the arm (`traverse identify`), and keep the covariance file beside "
        "the arm file",
    ),
    Condition(
        "temperature",
        "arm",
        "the temperature that corrections need is known",
        "a report of a device's sensor",
        "no sensor has reported for five of its periods",
        QualityFlag.TEMPERATURE_UNKNOWN,
        "all",
        "device.temperature_unknown",
        "connect the board's sensor, or take the effects that need the temperature "
        "out of the arm file",
    ),
    Condition(
        "motion",
        "arm",
        "speed and last sense of motion that corrections or limits need are known",
        "joints that have moved since the start",
        "a start, or readings that were missing",
        QualityFlag.MOTION_UNKNOWN,
        "samples",
        "condition.motion",
        "move every joint a little",
        severity="warning",
    ),
    Condition(
        "effects",
        "arm",
        "corrections are used within what they were measured for",
        "samples within the time and the range of every correction",
        "a correction bound to time is used later, or a curve beyond its knots",
        QualityFlag.STALE_EFFECT | QualityFlag.BEYOND_KNOTS,
        "samples",
        "condition.effects",
        "stay within what was measured, or identify the arm again",
        severity="warning",
    ),
    Condition(
        "temperature_band",
        "arm",
        "the arm's temperature, and its rate, are within [quality]; without limits "
        "there, within 3 °C of those of the identification, or 15 °C with an effect "
        "that corrects for it",
        "a temperature within the band",
        "one outside, a quick change, or no temperature where [quality] has limits",
        QualityFlag.TEMPERATURE,
        "all",
        "limit.temperature",
        "wait until the temperature has settled, and check the sensor and its unit; or "
        "identify the arm at this one, or with its expansion",
        severity="warning",
    ),
    Condition(
        "identification_age",
        "arm",
        "the identification is not older than [quality] allows",
        "the date in the arm file",
        "age, or an arm file without a date",
        QualityFlag.STALE_IDENTIFICATION,
        "all",
        "limit.stale_identification",
        "check the arm, and identify it again",
        severity="warning",
    ),
    Condition(
        "utc",
        "host",
        "the computer's UTC can be believed",
        "a possible time that a program keeps synchronised, or that was confirmed once "
        "for this computer",
        "a time that cannot be, or of which nothing says that it is right; one that is "
        "set by more than a minute while no program keeps it",
        QualityFlag.UTC_UNCERTAIN,
        "all",
        "condition.utc",
        "set the computer's clock, and let it be synchronised",
        command="reference",
        remembered="the latest time that was believed, and how it was set since",
    ),
)
BY_NAME = {condition.name: condition for condition in CONDITIONS}
"""Conditions by name."""
