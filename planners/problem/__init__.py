"""What is asked: posture problems, courses, their files, and the features that a policy sees of them."""

from .posture import Contact, PostureProblem
from .posture_batch import PostureBatch

__all__ = ["Contact", "PostureBatch", "PostureProblem"]
