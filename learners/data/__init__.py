"""Data sets of labelled postures (Algorithm E1): drawing, files, processes.

Read ``labelling``, ``shards`` and ``executors`` (who works), then ``leap_tries``; ``ray_driver`` is
what runs on a cluster.
"""
