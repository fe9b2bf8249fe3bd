"""Replay: recorded counts in the place of a moving arm."""

from traverse.simulator.motions.motion import Motion
from traverse.simulator.motions.stage import CourseBuilder
from traverse.simulator.scenario.recorded_counts import read_recording
from traverse.simulator.scenario.script import ScriptEvent


class ReplayMotion(Motion):
    """Play the counts of a CSV file; the inputs change as in its columns."""

    file: str

    def play(self, stage: CourseBuilder) -> None:
        """Append this motion to the course: its duration, and its inputs."""
        recording = read_recording(stage.folder / self.file)
        stage.events += [
            ScriptEvent(time_s, name, level)
            for time_s, name, level in recording.input_changes()
        ]
        stage.rest(recording.duration_s)
