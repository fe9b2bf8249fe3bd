"""Best fit of features: drawn features with errors that they share, and mistakes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from traverse.client.inspection.best_fit import best_fit
from traverse.kinematics.features.measured import Features
from traverse.kinematics.fits.elements import Element
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance

NOMINALS_MM = {
    "hole a": (0.0, 0.0, 0.0),
    "hole b": (300.0, 0.0, 0.0),
    "hole c": (300.0, 200.0, 0.0),
    "ball": (50.0, 150.0, 80.0),
}
PLACES_MM = np.array([*NOMINALS_MM.values()])
OWN_MM, SHARED_MM = 0.01, 0.03
# Each feature is the mean of two touches; the first three share the last touch.
N_TOUCHES = 9


def weights():
    by_touches = np.zeros((4, 8, N_TOUCHES, 3))
    for row in range(4):
        for axis in range(3):
            by_touches[row, axis, 2 * row : 2 * row + 2, axis] = 0.5
            if row < 3:
                by_touches[row, axis, 8, axis] = 0.7
    return by_touches


def features(places_mm, shared_mm):
    values = np.zeros((4, 8))
    values[:, :3] = places_mm
    own_mm2 = np.tile(OWN_MM**2 * np.eye(3), (N_TOUCHES, 1, 1))
    errors = JointCovariance(
        np.repeat(places_mm, [2, 2, 2, N_TOUCHES - 6], axis=0),
        own_mm2 + shared_mm @ shared_mm.transpose(0, 2, 1),
        shared_mm,
    )
    elements = {
        name: Element("sphere" if name == "ball" else "circle", of, by_touches)
        for name, of, by_touches in zip(NOMINALS_MM, values, weights(), strict=True)
    }
    return Features(elements, errors, {})


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def drawn(rng, places_mm=PLACES_MM):
    """Draw an arm's place and the errors of its touches; return features and truth."""
    rotation = Rotation.random(random_state=rng).as_matrix()
    shift_mm = rng.uniform(-500, 500, 3)
    true_mm = (places_mm - shift_mm) @ rotation
    shared_mm = SHARED_MM * rng.normal(size=(N_TOUCHES, 3, 2))
    touches_mm = OWN_MM * rng.normal(size=(N_TOUCHES, 3))
    touches_mm += shared_mm @ rng.normal(size=2)
    errors_mm = np.einsum("fati,ti->fa", weights()[:, :3], touches_mm)
    return features(true_mm + errors_mm, shared_mm), (rotation, shift_mm)


def test_what_is_stated_is_what_comes(rng):
    """Of 400 drawn arms: chi-squared of residuals, and errors in the part's volume."""
    squares, ratios = [], []
    for _ in range(400):
        measured, (rotation, shift_mm) = drawn(rng)
        fit = best_fit(measured, NOMINALS_MM, is_known=True)
        squares.append(fit.sigma0**2 * fit.redundancy)
        inside_mm = rng.uniform(PLACES_MM.min(0), PLACES_MM.max(0), (200, 3))
        off_mm = fit.system.places_mm((inside_mm - shift_mm) @ rotation) - inside_mm
        factor = max(1.0, fit.sigma0**2) if fit.doubts else 1.0
        ratios.append(np.mean(np.sum(off_mm**2, axis=1)) / fit.error.rms_mm**2 * factor)
    assert fit.redundancy == 6
    assert np.mean(squares) == pytest.approx(6.0, abs=0.6)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15)


def test_an_exchange_of_places_is_a_doubt(rng):
    measured, _ = drawn(rng)
    moved = NOMINALS_MM | {"hole c": (300.0, 201.0, 0.0)}
    doubts = best_fit(measured, moved, is_known=True).doubts
    assert any("times what U lets expect" in doubt for doubt in doubts)
    assert best_fit(measured, NOMINALS_MM, is_known=True).doubts == ()
    unknown = best_fit(measured, NOMINALS_MM, is_known=False)
    assert unknown.error is None
    assert unknown.doubts[0].startswith("U of the features is not known")


def test_places_that_fit_in_another_order_are_a_doubt(rng):
    corners = (
        (0.0, 0.0, 0.0),
        (300.0, 0.0, 0.0),
        (300.0, 200.0, 0.0),
        (0.0, 200.0, 0.0),
    )
    rectangle = dict(zip(NOMINALS_MM, corners, strict=True))
    measured, _ = drawn(rng, np.array(corners))
    doubts = best_fit(measured, rectangle, is_known=True).doubts
    assert any("fit as well in another order (hole a as hole b" in d for d in doubts)


def test_three_features_show_no_error_across_their_plane(rng):
    measured, _ = drawn(rng)
    three = {name: NOMINALS_MM[name] for name in ("hole a", "hole b", "hole c")}
    fit = best_fit(measured, three, is_known=True)
    assert "not in one plane" in fit.doubts[0]
    narrow = three | {"hole c": (150.0, 5.0, 0.0)}
    measured, _ = drawn(rng, np.array([*narrow.values(), NOMINALS_MM["ball"]]))
    doubts = best_fit(measured, narrow, is_known=True).doubts
    assert any("nearly on one line" in doubt for doubt in doubts)
    assert any("an error of a feature counts" in doubt for doubt in doubts)


@pytest.mark.parametrize(
    ("nominals_mm", "message"),
    [
        ({"hole a": (0, 0, 0), "hole b": (300, 0, 0)}, "on one line"),
        ({**NOMINALS_MM, "slot": (1, 2, 3)}, "slot: not measured"),
        ({n: (x, y, -z) for n, (x, y, z) in NOMINALS_MM.items()}, "mirror image"),
    ],
)
def test_what_determines_no_system_is_refused(rng, nominals_mm, message):
    measured, _ = drawn(rng)
    with pytest.raises(ValueError, match=message):
        best_fit(measured, nominals_mm, is_known=True)


def test_a_plane_has_no_place(rng):
    measured, _ = drawn(rng)
    measured.elements["plate"] = Element("plane", np.zeros(8), weights()[0])
    with pytest.raises(ValueError, match="plate: a plane has no place of its own"):
        best_fit(measured, {**NOMINALS_MM, "plate": (0, 0, 0)}, is_known=True)
