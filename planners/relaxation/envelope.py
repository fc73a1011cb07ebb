"""Envelopes, where relaxations look for them."""

from ..contact.envelope import Envelope, EnvelopeSet

__all__ = ["Envelope", "EnvelopeSet"]
