"""Contact planning (paper E): P exact, P̄, P1 over envelopes or the lift, P2."""
