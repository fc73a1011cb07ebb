"""The independent verifier: it knows the problem or course and the answer, and nothing of how the
answer was made.

``check_plan`` judges answers, ``check_certificate`` proofs that there is none, of a posture problem
or of a course alike; ``explain`` says what such a proof gives as its reason. The batches,
``check_postures`` and ``check_certificates``, give numbers in place of reports. No solver takes
part in a verdict on contacts or on a proof, and no code of a planner in anything.

Read ``stances``, ``geometry`` and ``plans`` (plans), ``trajectories``, ``leaps``, ``motions`` (the
rest), then ``lagrangian``, ``certificate`` and ``flood`` (proofs), ``explanation`` (their sentences).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ..answer.report import (
    GROUPS as GROUPS,
    PLAN_GROUPS as PLAN_GROUPS,
    Group as Group,
    Report as Report,
)
from .plans import BETWEEN as BETWEEN, check_plan as check_plan
from .postures import check_postures as check_postures, check_whole_body as check_whole_body

if TYPE_CHECKING:
    from .certificate import (
        check_certificate as check_certificate,
        check_certificates as check_certificates,
    )
    from .explanation import (
        Explanation as Explanation,
        Relaxation as Relaxation,
        explain as explain,
    )
else:

    def __getattr__(name: str) -> Any:
        """A name of the proofs, at its first use (PEP 562): most answers have none."""
        homes = {"check_certificate": ".certificate", "check_certificates": ".certificate"}
        if name not in (*homes, "Explanation", "Relaxation", "explain"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(homes.get(name, ".explanation"), __name__), name)
