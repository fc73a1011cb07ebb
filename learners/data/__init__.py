"""Data sets of labelled postures (Algorithm E1): drawing, files, processes, episodes for others.

Read ``labelling``, ``shards`` and ``executors`` (who works), then ``leap_tries``, ``export``;
``ray_driver`` is what runs on a cluster.
"""
