"""Networks that propose witnesses and proofs, which the verifier decides on."""
