"""Published experiments as functions, each also a command `warpdem run NAME`."""

from .mode_i import ModeI, ModeIResult, mode_i

__all__ = ["ModeI", "ModeIResult", "mode_i"]
