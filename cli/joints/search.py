"""Which encoder each joint has: found by turning one joint after the other."""

from typing import TYPE_CHECKING

from traverse.drivers.turning import Track, Turned, turned_joint

if TYPE_CHECKING:
    from traverse.cli.joints.devices import TurningDevices
    from traverse.kinematics.arm_file.arm import Arm, Joint


class JointSearch:
    """The joints of an arm, and the encoders that were found for them.

    Args:
        arm: Its encoder tables may be missing.
        angle_deg: About how far each joint is turned.

    Attributes:
        turned: The encoder of each joint that was found, by the joint's name.
        noise_counts: Range of each channel at rest, by its source.
    """

    def __init__(self, devices: "TurningDevices", arm: "Arm", angle_deg: float) -> None:
        self.turned: dict[str, Turned] = {}
        self.noise_counts: dict[str, int] = {}
        self._devices = devices
        self._arm = arm
        self._angle_deg = angle_deg

    async def rest(self) -> None:
        """Wait for all devices, and measure the noise of the resting arm.

        Raises:
            RefusalError: A device cannot be reached, or sends nothing.
        """
        await self._devices.connected()
        await self._devices.rested()
        self.noise_counts = {
            track.source: track.highest_counts - track.lowest_counts
            for track in self._devices.tracks
        }

    def begin(self) -> None:
        self._devices.begin()

    async def take(self, joint: "Joint") -> Turned | str:
        """Find the encoder of a joint that was turned since `begin`.

        Returns:
            The encoder, which is kept, or why it is unknown, in a sentence.
        """
        await self._devices.settled()
        expected = joint.encoder.counts_per_turn if joint.encoder else None
        outcome = turned_joint(
            self._devices.tracks, self.noise_counts, self._angle_deg / 360.0, expected
        )
        if isinstance(outcome, str):
            return outcome
        for name, known_outcome in self.turned.items():
            if known_outcome.source == outcome.source and name != joint.name:
                return f"{outcome.source} is {name}'s encoder already"
        if outcome.counts_per_turn is None:
            return (
                f"{outcome.source} moved by {outcome.moved_counts} counts, which fits "
                "no counts per turn of the device; turn it by the angle, or write "
                "counts_per_turn into the arm file first"
            )
        self.turned[joint.name] = outcome
        return outcome

    @property
    def missing(self) -> list[str]:
        return [j.name for j in self._arm.joints if j.name not in self.turned]

    def arm_with_encoders(self) -> "Arm":
        from traverse.kinematics.arm_file.arm import Encoder

        joints = []
        for joint in self._arm.joints:
            outcome = self.turned.get(joint.name)
            if outcome is None:
                joints.append(joint)
                continue
            values = {
                "source": outcome.source,
                "sign": outcome.sign,
                "counts_per_turn": outcome.counts_per_turn,
            }
            encoder = (
                Encoder.model_validate(values)
                if joint.encoder is None
                else joint.encoder.model_copy(update=values)
            )
            is_same = encoder == joint.encoder
            joints.append(
                joint if is_same else joint.model_copy(update={"encoder": encoder})
            )
        return self._arm.model_copy(update={"joints": tuple(joints)})

    def prompt(self, joint: "Joint") -> str:
        axis = " ".join(f"{component:g}" for component in joint.axis)
        return (
            f"{joint.name}: turn it alone by about {self._angle_deg:g} degrees, "
            f"right-handed about its axis ({axis})"
        )


def channel_sentence(track: Track, noise_counts: int, alarm: str) -> str:
    words = [f"{track.source}: {track.modulus_counts} counts, moves by {noise_counts}"]
    for n, defect in (
        (track.n_invalid, "without a valid count"),
        (track.n_weak, "with a weak signal"),
    ):
        if n:
            words.append(f"{n / track.n_samples:.0%} of samples {defect}")
    if alarm:
        words.append(alarm)
    return "; ".join(words)


def encoder_sentence(joint: "Joint", outcome: Turned) -> str:
    """Describe an encoder that was found, beside the arm file's entry."""
    degrees = 360.0 * (outcome.angle_turns or 0.0)
    text = (
        f"{joint.name}: {outcome.source}, sign {outcome.sign:+d}, "
        f"{outcome.counts_per_turn} counts per turn; it turned by {degrees:.1f} degrees"
    )
    before = joint.encoder
    if before is None:
        return text
    values = (before.source, before.sign, before.counts_per_turn)
    if values == (outcome.source, outcome.sign, outcome.counts_per_turn):
        return f"{text}: as in the arm file"
    return f"{text}; the arm file had {before.source}, {before.sign:+d}, {values[2]}"
