"""The independent verifier: it knows the problem or course and the answer, and nothing of how the answer was made.

``check_posture`` and ``check_plan`` judge answers, ``check_certificate`` proofs that there is none, of a posture
problem or of a course alike; ``explain`` says what such a proof gives as its reason. The batches, ``check_postures``
and ``check_certificates``, give numbers in place of reports. No solver takes part, and no code of a planner.
"""

from .certificate import CertificateReport as CertificateReport
from .certificate import check_certificate as check_certificate
from .certificate import check_certificates as check_certificates
from .explain import Explanation as Explanation
from .explain import Relaxation as Relaxation
from .explain import explain as explain
from .joints import check_joints as check_joints
from .plans import BETWEEN as BETWEEN
from .plans import check_plan as check_plan
from .postures import check_posture as check_posture
from .postures import check_postures as check_postures
from .report import GROUPS as GROUPS
from .report import PLAN_GROUPS as PLAN_GROUPS
from .report import GroupViolation as GroupViolation
from .report import Report as Report
