"""The command ``stancekit``: one file per command; the only layer that prints."""
