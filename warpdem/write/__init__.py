"""Observers and functions that write files, each whole or not at all.

Nothing is imported here: USD and pictures take a second to load and not every run writes them.
"""
