"""What an assembly makes, compared with the true motion."""

import numpy as np

from tests.daemon.two_devices import BEGIN_NS, TURNS, true_counts

AT_ONCE = BEGIN_NS  # no deadline has passed by then
MUCH_LATER = BEGIN_NS + 10**12


def joined(made):
    """Numbers, instants, counts over all turns, status and doubts of all samples."""
    seq = np.concatenate([samples.seq for samples, _ in made])
    times_ns = np.concatenate([samples.sample_time_ns for samples, _ in made])
    counts = np.concatenate(
        [samples.counts.astype(float) + samples.fractions for samples, _ in made]
    )
    status = np.concatenate([samples.status for samples, _ in made])
    doubts = np.concatenate([bounds[:, :, 0] for _, bounds in made])
    return seq, times_ns, counts, status, doubts


def off_counts(counts, expected, joint=slice(None)):
    """How far counts, of all joints or one, are off, by the shortest way round."""
    turns = TURNS[joint]
    return (counts - expected + turns / 2) % turns - turns / 2


def interpolated(reader, seq, joint, instants_ns):
    """What numpy's own interpolation makes of the readings of a joint."""
    times_ns = reader.reading_times_ns(seq, joint)
    rounded = np.rint(true_counts(times_ns, reader.speed)[:, joint])
    return np.interp(
        (instants_ns - BEGIN_NS) * 1.0, (times_ns - BEGIN_NS) * 1.0, rounded
    )
