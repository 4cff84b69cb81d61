"""Observers and functions that write files, each whole or not at all."""

from .usd import UsdWriter

__all__ = ["UsdWriter"]
