"""The command ``stancekit``: one file a verb; the only floor that prints."""
