"""Realistic joint friction for MuJoCo: simulate it, identify it, and find the effect that is missing."""

__version__ = "0.1.0"
