"""Collecting a campaign: plan, targets, what has been touched."""
