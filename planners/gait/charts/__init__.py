"""Charts: coordinates in which a walk is optimised (paper W §IV-C); each a file, and a line in the table here."""
