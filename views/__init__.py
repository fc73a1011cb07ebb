"""Pictures, pages and films of scenes, answers and runs.

Read ``scene`` (what is drawn), ``still``, ``page`` and ``film`` (how), then the kinds:
``plans``, ``postures``, ``gaits``, ``leaps``, ``terrain``, ``robots``.
"""
