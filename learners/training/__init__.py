"""Learning by name: every method of ``stancekit fit``, and reinforcement.

Read ``fitting`` (every method by name), then ``network_methods``, ``train_config``, ``reinforce``.
"""
