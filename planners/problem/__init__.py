"""Problems of one key frame or several, their files, and the features that a policy sees of
them.
"""

from __future__ import annotations

from .contact import Contact
from .posture_batch import PostureBatch
from .problem import Problem

__all__ = ["Contact", "PostureBatch", "Problem"]
