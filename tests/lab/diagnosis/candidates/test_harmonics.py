"""Harmonics against direct formulas, and against the library."""

import numpy as np

from tests.lab.diagnosis.candidates.test_library import chosen
from tests.lab.diagnosis.fitted_rows import measured, measured_rows, serial_rows
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.candidates.waves import HIGHEST_HARMONIC, harmonic_bank

JOINTS = [f"J{k}" for k in range(1, 8)]


def test_harmonics_are_waves_of_the_reading():
    rows = measured_rows()
    bank = harmonic_bank(rows)
    assert len(bank.candidates) == 7 * HIGHEST_HARMONIC
    scales = {1: 3e-5, 2: 2e-5, 3: 1e-5, 4: 1e-5, 5: 5e-6, 60: 5e-6}
    for order, scale in scales.items():
        for joint in (0, 4):
            at = joint * HIGHEST_HARMONIC + order - 1
            candidate = bank.candidates[at]
            assert candidate.joint == JOINTS[joint]
            assert candidate.scales == (scale, scale)
            kind = "encoder_eccentricity" if order == 1 else "encoder_harmonic"
            assert (candidate.kind, candidate.order or 1) == (kind, order)
            phases_rad = order * rows.block.angles_rad[rows.poses, joint]
            waves = np.stack([np.cos(phases_rad), np.sin(phases_rad)], axis=1)
            expected = scale * rows.by_readings[:, [joint]] * waves
            np.testing.assert_allclose(bank.columns[:, bank.slices[at]], expected)


def test_low_harmonics_are_those_of_the_library():
    rows = measured_rows()
    library, harmonics = library_bank(rows, measured().arm), harmonic_bank(rows)
    identities = {candidate.identity for candidate in library.candidates}
    shared = [c for c in harmonics.candidates if c.identity in identities]
    assert len(shared) == 7 * 4
    for harmonic in shared:
        of_library = {
            "kind": harmonic.kind,
            "joint": harmonic.joint,
            "order": harmonic.order,
        }
        same, expected = chosen(library, **of_library)
        assert (same.scales, same.log_prior) == (harmonic.scales, harmonic.log_prior)
        columns = harmonics.slices[harmonics.candidates.index(harmonic)]
        np.testing.assert_allclose(
            harmonics.columns[:, columns], expected, atol=1e-6 * np.abs(expected).max()
        )


def test_serial_correlation_is_taken_out_of_harmonics():
    rows, serial = measured_rows(), serial_rows()
    plain, whitened = harmonic_bank(rows).columns, harmonic_bank(serial).columns
    np.testing.assert_allclose(
        serial.root @ whitened, plain, atol=1e-9 * np.abs(plain).max()
    )
