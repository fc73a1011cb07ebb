"""How a walk is found: a guess, a homotopy, smoothing, densification, and a portfolio of attempts on one budget."""
