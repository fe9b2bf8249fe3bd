"""What the log says of the arm that is measured with."""

import logging

from traverse.daemon.pose.arm_model import ArmModel
from traverse.protocol.messages.point import Compensation

log = logging.getLogger("traverse.daemon.service")

WITHOUT_DIRECTION: tuple[Compensation, ...] = ("none", "shank")


def log_model(model: ArmModel, compensation: Compensation) -> None:
    """Log name, digest and effects, and which of them cannot be applied."""
    log.info("arm %s, model %s", model.name, model.digest[:12])
    if names := model.effect_names:
        log.info("effects applied: %s", ", ".join(names))
    if model.effects.contacts and compensation in WITHOUT_DIRECTION:
        log.warning(
            "effects of the contact are left out: `compensation` in [capture] is "
            "not one that finds the direction of the surface (pretouch, pulled, "
            "inside, outside); every point is flagged surface_unknown"
        )
