"""The limit that is in the way of many problems at once is that which `explain` names first, by kind,
where one limit of one limb is enough.
"""

from collections import Counter

import stancekit
from stancekit.planners.verify.explanation import LIMITS, SEVERAL, hindrances


def test_every_proof_has_a_limit_that_weakens_it() -> None:
    certificates = [
        certificate
        for problem in stancekit.sample("wall-3", 40, rng=2)
        if (certificate := stancekit.solve(problem).certificate) is not None
    ]
    assert len(certificates) > 10
    names = hindrances(certificates)
    assert set(names) <= {*LIMITS, SEVERAL}
    assert Counter(names)[SEVERAL] < len(names) / 4
    assert hindrances([]) == []
    assert names == [hindrances([each])[0] for each in certificates]


def test_short_limbs_are_in_the_way_of_themselves() -> None:
    problem = stancekit.sample("ground-3", rng=3)[0]
    contacts = [
        stancekit.Contact(
            leg=contact.leg,
            shoulder_m=contact.shoulder_m,
            reach_m=0.1,
            patch=contact.patch,
            force_min=contact.force_min,
            force_max=contact.force_max,
        )
        for contact in problem.contacts
    ]
    certificate = stancekit.solve(problem.posture_with(contacts=contacts)).certificate
    assert certificate is not None
    assert hindrances([certificate]) == ["reach"]
