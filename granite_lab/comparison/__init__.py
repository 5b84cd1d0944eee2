"""Measured against simulated, channel by channel and phase by phase."""
