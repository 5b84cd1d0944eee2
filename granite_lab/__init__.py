"""Experiment analysis for a light four-wheeled robot driving straight over dry sand."""

__version__ = "0.1.0"
