"""Published experiments as functions, each also a command `warpdem run NAME`."""

from .mode_i import ModeI, ModeIResult, mode_i
from .shared import Result

__all__ = ["ModeI", "ModeIResult", "Result", "mode_i"]
