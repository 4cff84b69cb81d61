"""`python -m warpdem` is the command `warpdem`."""

from .cli import main

if __name__ == "__main__":
    main()
