"""Learning and comparing envelope selectors."""
