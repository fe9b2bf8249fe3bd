"""Durable queue of points and scan blocks: write, forward, acknowledge, resend."""
