"""What a plan is, how to compute one and how to check one; knows no gymnasium and no torch."""
