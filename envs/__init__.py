"""The world as an agent sees it: terrains, Gymnasium environments, pictures.

Importing this package registers the environments, so ``gymnasium.register_envs(stancekit.envs)``
works, and so does ``gymnasium.make("stancekit.envs:stancekit/EnvelopeSelection-v0")``.

Read ``scenes`` (what is drawn), ``episodes`` (how it is handed out and rewarded), then a task:
``selection``, ``refinement``, ``traverse``, ``leap_choice``, ``warped_gait``; ``vector`` last.
"""

import gymnasium

gymnasium.register(
    id="stancekit/EnvelopeSelection-v0",
    entry_point="stancekit.envs.selection:EnvelopeSelectionEnv",
    vector_entry_point="stancekit.envs.vector:EnvelopeSelectionVectorEnv",
    order_enforce=True,
)
gymnasium.register(
    id="stancekit/EnvelopeRefinement-v0",
    entry_point="stancekit.envs.refinement:EnvelopeRefinementEnv",
    order_enforce=True,
)
gymnasium.register(
    id="stancekit/Traverse-v0",
    entry_point="stancekit.envs.traverse:TraverseEnv",
    order_enforce=True,
)
gymnasium.register(
    id="stancekit/WarpedGait-v0",
    entry_point="stancekit.envs.warped_gait:WarpedGaitEnv",
    order_enforce=True,
)
gymnasium.register(
    id="stancekit/LeapChoice-v0",
    entry_point="stancekit.envs.leap_choice:LeapChoiceEnv",
    order_enforce=True,
)
