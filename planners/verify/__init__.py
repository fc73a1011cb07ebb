"""The independent verifier: it knows the problem or course and the answer, and nothing of how the
answer was made.

``check_plan`` judges answers, ``check_certificate`` proofs that there is none, of a posture problem
or of a course alike; ``explain`` says what such a proof gives as its reason. The batches,
``check_postures`` and ``check_certificates``, give numbers in place of reports. No solver takes
part in a verdict on contacts or on a proof, and no code of a planner in anything.

Read ``stances``, ``geometry`` and ``plans`` (plans), ``trajectories``, ``leaps``, ``motions`` (the
rest), then ``lagrangian``, ``certificate`` and ``flood`` (proofs), ``explain`` (their sentences).
"""

from ..answer.report import GROUPS as GROUPS
from ..answer.report import PLAN_GROUPS as PLAN_GROUPS
from ..answer.report import Group as Group
from ..answer.report import Report as Report
from .certificate import check_certificate as check_certificate
from .certificate import check_certificates as check_certificates
from .explain import Explanation as Explanation
from .explain import Relaxation as Relaxation
from .explain import explain as explain
from .plans import BETWEEN as BETWEEN
from .plans import check_plan as check_plan
from .postures import check_postures as check_postures
from .postures import check_whole_body as check_whole_body
